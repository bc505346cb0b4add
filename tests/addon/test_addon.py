"""The add-on in Blender itself, against a server: a click sets the modifier, and whatever goes wrong is a sentence."""

import contextlib
import json
import os
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np
import psutil
import pytest
from attacking import free_port
from PIL import Image
from serving import box_checkpoint, serving
from stand_ins import broken, dying, other_api, page, standing_in

import dipcg
from dipcg.app import training_queue
from dipcg.app.studio import Studio
from dipcg.camera import View
from dipcg.cli.addon import packed
from dipcg.generators import load_generator
from dipcg.images import save_image
from dipcg.labels import label
from dipcg.render import Renderer
from dipcg.workers.pool import BuildPool

HERE = Path(__file__).parent
LAMP = str(HERE.parents[1] / "examples" / "lamp.toml")
SPACE = load_generator(LAMP).space

# Blender 4.2 is in our own environment. `make newer-blender` installs a newer one.
NEWER = os.environ.get("DIPCG_NEWER_BLENDER", str(HERE.parents[1] / ".newer-blender" / "bin" / "python"))
PYTHONS = [pytest.param(sys.executable, id="4.2"), pytest.param(NEWER, id="newer")]
STRANGERS, TREE = HERE.parents[2] / "shared" / "blends", "Ico Tree"

pytestmark = [pytest.mark.blender, pytest.mark.skipif(find_spec("bpy") is None, reason="bpy not installed")]


@pytest.fixture(scope="module")
def extensions(tmp_path_factory) -> Path:
    """A folder of extensions with the add-on, unpacked from the zip as Blender does it."""
    folder = tmp_path_factory.mktemp("extensions")
    zipfile.ZipFile(BytesIO(packed())).extractall(folder / "user_default" / "dipcg")
    return folder


@pytest.fixture(scope="module", params=PYTHONS)
def blender(request, extensions) -> Callable[..., dict]:
    """Runs a case of in_blender.py in Blender 4.2, and in a newer one where there is one."""
    if not Path(request.param).exists():
        pytest.skip("no newer Blender; `make newer-blender` installs one")

    def run(case: str, **options: object) -> dict:
        words = [request.param, str(HERE / "in_blender.py"), case, json.dumps(options)]
        environment = os.environ | {"BLENDER_USER_EXTENSIONS": str(extensions)}
        done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return run


@pytest.fixture(scope="module")
def lamp_picture(tmp_path_factory) -> Path:
    """A lamp that is not in the middle of a wide picture."""
    path, renderer = tmp_path_factory.mktemp("pictures") / "lamp.png", Renderer(256)
    with BuildPool(LAMP) as pool:
        mesh = pool.build(SPACE.sample(np.random.default_rng(1)))
    wide = np.zeros((300, 500, 4), np.uint8)
    wide[30:286, 200:456] = renderer.render(mesh, View(30.0, 20.0, 2.5))
    renderer.close()
    save_image(wide, path)
    return path


@pytest.fixture(scope="module")
def lamp_server(tmp_path_factory) -> Iterator[str]:
    """A server over the lamp, whose estimator is untrained."""
    checkpoint = box_checkpoint(tmp_path_factory.mktemp("checkpoint"), LAMP)
    with Studio([checkpoint], workers=1) as studio, serving(studio, tmp_path_factory.mktemp("served")) as address:
        yield address


# A click


@pytest.fixture(scope="module")
def clicked(blender, lamp_server, lamp_picture) -> dict:
    return blender("lamp", address=lamp_server, picture=str(lamp_picture))


def stored(params: dict) -> dict:
    """The values that the modifier stores for parameters of the lamp, by the declaration."""
    declared = tomllib.loads(Path(LAMP).read_text())["parameters"]
    found: dict = {}
    for name, entry in declared.items():
        value = np.radians(params[name]) if entry.get("unit") == "°" else params[name]
        value = round(value) if entry["kind"] == "integer" else value
        if "component" in entry:
            found.setdefault(entry["input"], []).append(value)
        else:
            found[entry["input"]] = value
    return found


def test_a_click_sets_every_input_to_the_candidate(clicked) -> None:
    chosen = clicked["result"]["candidates"][1]["params"]
    assert clicked["generator"] == "lamp"
    for identifier, value in stored(chosen).items():
        expected = value if isinstance(value, str) else pytest.approx(value, rel=1e-5, abs=1e-7)
        assert clicked["after"]["values"][identifier] == expected, identifier


def test_the_mesh_after_a_click_is_that_of_the_candidate(clicked) -> None:
    with BuildPool(LAMP) as pool:
        expected = pool.build(SPACE.validate(clicked["result"]["candidates"][1]["params"])).bounds
    np.testing.assert_allclose(clicked["after"]["bounds"], expected, atol=1e-5)


def test_undo_brings_back_what_was_there(clicked) -> None:
    assert clicked["before"] != clicked["after"]["values"]
    assert clicked["undone"]["values"] == clicked["before"]
    assert "dipcg camera" not in clicked["undone"]["cameras"]


def test_the_camera_sees_the_object_where_the_picture_shows_it(clicked, lamp_picture) -> None:
    check_camera(clicked["after"]["seen"], lamp_picture)
    assert clicked["after"]["camera"] == "dipcg camera"
    assert clicked["after"]["resolution"] == clicked["after"]["behind"] == [500, 300]


def test_the_camera_of_the_truth_sees_the_truth_as_in_the_picture(blender, lamp_server, lamp_picture) -> None:
    truth = SPACE.sample(np.random.default_rng(1))
    view = {"azimuth_deg": 30.0, "elevation_deg": 20.0, "distance": 2.5}
    seen = blender("truth", address=lamp_server, picture=str(lamp_picture), params=truth, view=view)
    np.testing.assert_allclose(seen, rectangle(lamp_picture), atol=1 / 300)


def test_locked_inputs_keep_their_values(blender, lamp_server, lamp_picture) -> None:
    options = {"name": "lean", "identifier": "Socket_21", "value": float(np.radians(35))}
    result = blender("locked", address=lamp_server, picture=str(lamp_picture), **options)
    leans = [candidate["params"]["lean"] for candidate in result["candidates"]]
    assert leans == pytest.approx([35.0] * len(leans))
    assert len({candidate["params"]["height"] for candidate in result["candidates"]}) > 1


def test_a_generator_without_its_modifier_adds_an_object_with_materials(blender, address, picture) -> None:
    found = blender("added", address=address, picture=str(picture))
    assert (found["roots"], found["meshes"] > 0, all(found["materials"])) == (["box"], True, True)
    with BuildPool("box") as pool:
        expected = pool.build(load_generator("box").space.validate(found["result"]["candidates"][0]["params"])).bounds
    np.testing.assert_allclose(found["bounds"], expected, atol=1e-3)
    check_camera(found["seen"], picture)


def test_the_panels_show_every_candidate_and_every_parameter(clicked) -> None:
    shown = clicked["shown"]
    agreements = [f"{100 * candidate['agreement']:.0f} % match" for candidate in clicked["result"]["candidates"]]
    assert [text for text in shown if text.endswith("match")] == agreements
    assert {"Estimate", *(label(parameter) for parameter in SPACE)} <= set(shown)
    assert any(text.startswith("Sets Lamp: ") for text in shown)
    assert clicked["thumbnails"] == [[256, 256]] * len(agreements)


# Learning


@pytest.fixture
def learning(tmp_path, monkeypatch) -> Iterator[str]:
    """A server over the toy that learns in seconds; it has the newer Blender where there is one."""
    monkeypatch.setattr(training_queue, "PROGRAM", "learning_stand_in")
    monkeypatch.setenv("PYTHONPATH", str(HERE.parent))
    # It must still be training when it is stopped, also on a busy machine.
    monkeypatch.setenv("LEARNING_STEP_S", "0.5")
    served, learned = tmp_path / "served", tmp_path / "learned"
    options = {"learn": learned, "blender": NEWER if Path(NEWER).exists() else ""}
    with Studio([box_checkpoint(tmp_path / "box")], workers=1) as studio, serving(studio, served, **options) as url:
        yield url


def check_learned(found: dict, name: str) -> None:
    """It was stopped, found again, and ended; the panel then estimates with it for the active modifier."""
    assert found["stopped"]["state"] == "stopped"
    assert found["found"]["id"] == found["stopped"]["id"] == found["done"]["id"]
    assert found["done"]["state"] == "done"
    assert any("Step" in note for note in found["notes"])
    assert "Learn This Generator" in found["texts"]
    assert (found["status"], found["generator"], found["modifier"]) == ("Learned. Now estimate.", name, True)


def test_a_modifier_is_learned_stopped_and_found_again(blender, learning) -> None:
    options = {"ranges": {"height": [0.3, 0.6]}, "hold": ["finial"]}
    found = blender("learned", address=learning, blend=str(Path(LAMP).with_suffix(".blend")), name="Lamp", **options)
    check_learned(found, "lamp")
    assert found["proposed"]["height"] == pytest.approx([0.2, 0.8])
    assert found["proposed"]["shade"] is None
    done = {p["name"]: p for p in found["done"]["parameters"]}
    assert [done["height"]["low"], done["height"]["high"]] == [0.3, 0.6]
    assert [name for name, p in done.items() if p["held"]] == ["finial"]


@pytest.mark.skipif(not STRANGERS.is_dir(), reason="../shared/blends is not there")
def test_a_strangers_modifier_is_learned(blender, learning) -> None:
    path = STRANGERS / "low_poly_tree.blend"
    found = blender("learned", address=learning, blend=str(path), name=TREE, ranges={}, hold=[])
    check_learned(found, "ico_tree")


def test_the_server_is_started_from_the_preferences(blender, tmp_path) -> None:
    port, program = free_port(), tmp_path / "dipcg"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m dipcg.cli "$@" {tmp_path}/box-checkpoint\n')
    program.chmod(0o755)
    (tmp_path / "box-checkpoint").symlink_to(box_checkpoint(tmp_path / "made"))
    try:
        found = blender("started", port=port, program=str(program), folder=str(tmp_path / "learned"))
    finally:
        for process in psutil.process_iter(["cmdline"]):
            if str(tmp_path / "learned") in (process.info["cmdline"] or ()):
                process.terminate()
    assert "There is no answer" in found["before"]
    assert "/nowhere/dipcg cannot be started" in found["wrong"]
    assert found["generators"] == ["box"]
    # A newer Blender reads its own files for the server.
    assert found["command"][6:] == (["--blender", found["python"]] if found["is newer"] else [])


# What goes wrong


def test_whatever_goes_wrong_is_a_sentence_and_blender_goes_on(blender, lamp_server, lamp_picture, tmp_path) -> None:
    text = tmp_path / "text.png"
    text.write_text("no picture")
    with contextlib.ExitStack() as stack:
        others = [page, other_api, partial(dying, lamp_server)]
        html, json_, dead = (stack.enter_context(standing_in(answer)) for answer in others)
        asked = [
            ("http://example.org", lamp_picture, "Pictures stay on this machine"),
            ("http://127.0.0.1:9", lamp_picture, "There is no answer"),
            (html, lamp_picture, "is no dipcg server"),
            (json_, lamp_picture, "not one of a dipcg server"),
            (dead, lamp_picture, "There is no answer"),
            (lamp_server, text, "picture"),
            (lamp_server, tmp_path / "none.png", "No such file"),
        ]
        cases = [(address, str(picture)) for address, picture, _ in asked]
        found = blender("failing", cases=cases)
    for (address, _, words), sentence in zip(asked, found["sentences"], strict=True):
        assert words in sentence, address
        assert "Traceback" not in sentence
    assert found["sentences"] == [f"Error: {status}" for status in found["status"]]
    assert all(found["can go on"])
    assert found["changed"] is False
    assert found["left"] is False


def test_a_server_that_dies_in_a_training_is_a_sentence(blender) -> None:
    with standing_in(broken) as address:
        found = blender("dying", address=address)
    assert "There is no answer" in found["status"]
    assert (found["can go on"], found["watching"]) == (True, False)


def test_switching_off_stops_what_runs(blender, lamp_server) -> None:
    assert blender("stopping", address=lamp_server) == {"could start another": False, "ended": True}


# The package


def test_the_manifest_has_the_version_of_the_package() -> None:
    manifest = zipfile.ZipFile(BytesIO(packed())).read("blender_manifest.toml").decode()
    assert tomllib.loads(manifest)["version"] == dipcg.__version__


def test_the_zip_file_has_no_dates() -> None:
    with zipfile.ZipFile(BytesIO(packed())) as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_the_zip_is_a_valid_extension(tmp_path) -> None:
    (tmp_path / "dipcg.zip").write_bytes(packed())
    # The command `blender --command extension` runs this program.
    program = next(Path(find_spec("bpy").origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    done = subprocess.run([sys.executable, program, "validate", tmp_path / "dipcg.zip"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def rectangle(path: Path) -> list[float]:
    """The rectangle of what is opaque: left, bottom, right, top as shares of the picture."""
    alpha = np.asarray(Image.open(path))[..., 3]
    ys, xs = np.nonzero(alpha > 32)
    height, width = alpha.shape
    return [xs.min() / width, 1 - (ys.max() + 1) / height, (xs.max() + 1) / width, 1 - ys.min() / height]


def check_camera(seen: list[float], path: Path) -> None:
    """The object is in the middle of its place in the picture, and the longer side of both is the same."""
    size = np.array(Image.open(path).size)
    there, here = (np.array(rect).reshape(2, 2) * size for rect in (rectangle(path), seen))
    np.testing.assert_allclose(here.mean(0), there.mean(0), atol=1)
    np.testing.assert_allclose(np.ptp(here, 0).max(), np.ptp(there, 0).max(), atol=1)
