"""The app without a browser: what visitors can do to their work, the HTTP API, and what strangers may send."""

import base64
import io
import json
import os
import shlex
import shutil
import struct
import time
import urllib.error
import urllib.request
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
import trimesh
from boxes import BOX, TRUTH, VIEW
from gradio_client import Client, handle_file
from gradio_client.exceptions import AppError
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from serving import box_checkpoint, serving

from dipcg import app_actions, app_work, registry
from dipcg.app_cutout import Correction, corrected, shown
from dipcg.app_limits import MOST_BODY_BYTES
from dipcg.app_parameters import rows
from dipcg.app_studio import Studio
from dipcg.app_viewer import scene
from dipcg.app_work import Found, Work
from dipcg.cli import main
from dipcg.export import FORMATS
from dipcg.generators import load_generator
from dipcg.images import MAX_PIXELS, save_image
from dipcg.space import Real, params_from_json

T = TypeVar("T")
CASES = int(os.environ.get("DIPCG_FUZZ_CASES", "150"))  # of each fuzz test
OPEN = Work("box", (Found(TRUTH, VIEW),), 0, TRUTH)


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    with Studio([box_checkpoint(tmp_path_factory.mktemp("checkpoint"))], workers=1) as studio:
        yield studio


@pytest.fixture(scope="module")
def mesh(studio):
    return studio.build("box", TRUTH).mesh


@pytest.fixture(scope="module")
def picture(studio, mesh, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("pictures") / "box.png"
    save_image(studio.tiles([(mesh, VIEW)])[0], path)
    return path


@pytest.fixture(scope="module")
def client(studio, tmp_path_factory):
    with serving(studio, tmp_path_factory.mktemp("served")) as address:
        yield Client(address, verbose=False)


@pytest.fixture
def downloads(tmp_path) -> Path:
    (tmp_path / "downloads").mkdir()
    return tmp_path / "downloads"


# Parameters as rows


@pytest.mark.parametrize("name", registry.names("generators"))
def test_every_parameter_of_every_generator_has_one_row_that_json_can_carry(name):
    space = load_generator(name).space
    params = space.sample(np.random.default_rng(0))
    found = {row["name"]: row for part in rows(space, Work(name, params=params)) for row in part["rows"]}
    assert sorted(found) == sorted(space.names)
    assert json.loads(json.dumps(found)).keys() == found.keys()
    for p in space:
        row = found[p.name]
        assert (row["doc"], row["unit"], row["value"]) == (p.doc, p.unit, params[p.name])
        assert row["active"] == space.is_active(p.name, params)
        if isinstance(p, Real):
            assert p.low <= row["value"] <= p.high
            assert (p.high - p.low) / row["step"] >= 99.99


def test_what_the_picture_leaves_open_is_marked_and_what_is_held_is_not():
    chances = {"top": {"open": 0.1, "flat": 0.3, "pyramid": 0.6}}
    work = Work("box", params=TRUTH, spread={"width": 0.2, "depth": 0.001}, chances=chances)
    found = {row["name"]: row["unsure"] for part in rows(BOX, work) for row in part["rows"]}
    assert (found["width"], found["depth"], found["top"]) == ("± 0.200", "", "60 % sure")
    work = app_work.held(app_work.held(work, BOX, "width"), BOX, "top")
    assert not any(row["unsure"] for part in rows(BOX, work) for row in part["rows"])


# Editing

EDITS = st.lists(st.integers(0, 2**32 - 1).map(np.random.default_rng).map(BOX.sample), min_size=1, max_size=5)


@given(EDITS, st.data())
def test_undoing_every_edit_leads_back_to_what_was_opened(samples, data):
    work = OPEN
    for sample in samples:
        name = data.draw(st.sampled_from(BOX.names))
        work = app_work.edited(work, BOX, name, sample[name])
        assert work.params == BOX.canonical(work.params)
    assert len(work.before) == len(samples)
    assert app_work.reset(work).params == TRUTH
    for _ in samples:
        work = app_work.undone(work)
    assert work.params == TRUTH
    assert app_work.undone(work) == work


def test_one_drag_of_a_slider_is_one_step_to_undo():
    work = OPEN
    for value in (0.4, 0.5, 0.6):
        work = app_work.edited(work, BOX, "width", value, final=False)
    work = app_work.edited(work, BOX, "width", 0.7)
    assert (work.params["width"], work.before) == (0.7, (TRUTH,))
    again = app_work.edited(work, BOX, "width", 0.8)
    assert app_work.undone(again).params["width"] == 0.7


def test_random_keeps_what_is_held():
    work = app_work.held(OPEN, BOX, "depth")
    new = app_work.drawn_at_random(work, "box", BOX, np.random.default_rng(0))
    assert new.params["depth"] == TRUTH["depth"]
    assert new.params["width"] != TRUTH["width"]
    assert app_work.undone(new).params == TRUTH


def test_the_command_line_makes_the_same_file_again(studio, downloads, tmp_path):
    params = BOX.sample(np.random.default_rng(5))
    work = Work("box", params=params)
    words = shlex.split(app_actions.command(studio, work))
    assert words[0] == "dipcg"
    main([*words[1:-1], str(tmp_path / "again.glb")])
    made = app_actions.write(studio, downloads, "box", params, ".glb")
    assert made.read_bytes() == (tmp_path / "again.glb").read_bytes()


# Estimating


def test_an_estimate_is_the_pipelines_own(studio, picture):
    told = []
    found = studio.estimate(picture, "box", candidates=6, report=lambda share, words: told.append(share))
    expected = studio.inverters["box"].estimate(picture, candidates=6)
    assert 1 < len(found.candidates) <= 6
    assert all(c.params in [e.params for e in expected.candidates] for c in found.candidates)
    assert all(c.mesh is not None for c in found.candidates)
    assert told == sorted(told)
    strip = app_actions.strip(studio, found)
    assert len(strip["candidates"]) == len(found.candidates)
    tile = Image.open(io.BytesIO(base64.b64decode(strip["candidates"][0]["image"].split(",")[1])))
    assert 0.1 < (np.asarray(tile.convert("RGBA"))[..., 3] > 128).mean() < 0.95


def test_a_killed_worker_costs_no_candidate(studio, picture):
    def kill(share: float, words: str) -> None:
        if share == 0.1:
            studio.build("box", TRUTH)  # so that there is one to kill
            for child in list(studio.inverters["box"].pool._children):
                child._process.kill()

    undisturbed = studio.estimate(picture, "box", candidates=4)
    found = studio.estimate(picture, "box", candidates=4, report=kill)
    assert [c.params for c in found.candidates] == [c.params for c in undisturbed.candidates]
    for child in list(studio.inverters["box"].pool._children):
        child._process.kill()
    assert len(studio.build("box", TRUTH).mesh.faces) > 0


def test_held_values_stay_when_the_rest_is_estimated_again(studio, picture):
    found = studio.estimate(picture, "box", {"width": 0.35, "top": "pyramid"}, candidates=4, seed=3)
    assert {(c.params["width"], c.params["top"]) for c in found.candidates} == {(0.35, "pyramid")}


def test_a_scene_holds_the_surface_it_was_made_of(mesh):
    made = scene(mesh, VIEW, 1)
    vertices = np.frombuffer(base64.b64decode(made["vertices"]), "<f4").reshape(-1, 3)
    faces = np.frombuffer(base64.b64decode(made["faces"]), "<u4").reshape(-1, 3)
    assert trimesh.Trimesh(vertices, faces).area == pytest.approx(trimesh.Trimesh(mesh.vertices, mesh.faces).area)
    assert [part["first"] for part in made["parts"]] == np.cumsum(
        [0, *(p["count"] for p in made["parts"][:-1])]
    ).tolist()
    assert sum(part["count"] for part in made["parts"]) == faces.size


# The cut-out


def test_each_way_of_cutting_leaves_what_it_says():
    image = np.full((64, 64, 4), 255, np.uint8)
    image[16:48, 16:48, :3] = 120
    image[24:40, 24:40, :3] = 40
    mask = np.zeros((64, 64), np.uint8)
    mask[:32] = 255
    opaque = {
        "automatic": 32 * 32,
        "by colour": 16 * 16,  # what is far from white alone
        "own mask": 32 * 64,
        "nothing": 64 * 64,
    }
    for how, pixels in opaque.items():
        cut = corrected(image, Correction(how, 70.0, mask))
        found = shown(cut)[0][..., 3]
        share = pixels / max(np.ptp(np.nonzero(_alpha(cut, image)), axis=1) + 1) ** 2
        assert (found > 128).mean() == pytest.approx(share * (1 - 0.12) ** 2, rel=0.06), how


def _alpha(cut: np.ndarray, image: np.ndarray) -> np.ndarray:
    return cut[..., 3] > 128 if (cut[..., 3] < 128).any() else image[..., 0] < 200


# Files


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".obj", ".ply", ".stl"])
def test_written_files_have_the_size_that_the_parameters_say(studio, downloads, suffix):
    assert suffix in app_actions.endings()
    made = app_actions.write(studio, downloads, "box", TRUTH, suffix, "light")
    if suffix == ".obj":  # it comes with its materials
        shutil.unpack_archive(made, downloads / "unpacked")
        assert (downloads / "unpacked" / "box.mtl").is_file()
        made = downloads / "unpacked" / "box.obj"
    width = TRUTH["width"] + 2 * TRUTH["overhang"]
    assert trimesh.load(made).extents[0] == pytest.approx(width, abs=1e-4)


def test_parameters_are_written_as_edit_reads_them(studio, downloads):
    made = app_actions.write(studio, downloads, "box", TRUTH, ".json")
    name, params = params_from_json(made.read_text())
    assert (load_generator(name).name, params) == ("box", TRUTH)


def test_old_downloads_are_swept_and_new_ones_stay(studio, downloads):
    old, new = (app_actions.write(studio, downloads, "box", TRUTH, ".json") for _ in range(2))
    os.utime(old.parent, (0, time.time() - app_actions.KEPT_S - 1))
    app_actions.sweep(downloads, app_actions.KEPT_S)
    assert (old.exists(), new.exists()) == (False, True)


# Over HTTP


def test_a_program_gets_what_python_gets(client, studio, picture, tmp_path):
    found = client.predict(handle_file(picture), "box", 4, 0, {"width": 0.4}, api_name="/estimate")
    expected = studio.estimate(picture, "box", {"width": 0.4}, candidates=4)
    assert [c["params"] for c in found["candidates"]] == [c.params for c in expected.candidates]
    assert found["candidates"][0]["agreement"] == pytest.approx(expected.candidates[0].agreement)
    best = found["candidates"][0]["params"]
    file = client.predict("box", best, ".glb", False, api_name="/build")
    assert trimesh.load(file).extents.max() > 0.2
    assert client.predict(api_name="/generators") == [{"name": "box", "parameters": BOX.describe()}]
    cut = Image.open(client.predict(handle_file(picture), None, api_name="/cut_out"))
    assert np.asarray(cut)[..., 3].min() == 0


@pytest.mark.parametrize(
    ("words", "endpoint", "said"),
    [
        (["box", {"width": 99}, ".glb", False], "/build", "These parameters are missing"),
        (["box", TRUTH | {"width": 99}, ".glb", False], "/build", "width must be a number from 0.3 to 1 m, got 99."),
        (["box", TRUTH, ".exe", False], "/build", "There is no format '.exe'"),
        (["box", "all of them", ".glb", False], "/build", "Parameters are an object"),
        (["bax", TRUTH, ".glb", False], "/build", "Did you mean 'box'?"),
        (["../../etc/passwd", TRUTH, ".glb", False], "/build", "There is no generator"),
    ],
)
def test_what_a_program_asks_wrongly_is_answered_in_a_sentence(client, words, endpoint, said):
    with pytest.raises(AppError) as caught:
        client.predict(*words, api_name=endpoint)
    assert said in str(caught.value)
    assert "Traceback" not in str(caught.value)


def bomb(side: int) -> bytes:
    """A PNG of a few kilobytes that would fill memory."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    rows_of_zeros = zlib.compress(b"\0" * (side * (side // 8 + 1)), 9)
    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows_of_zeros) + chunk(b"IEND", b"")


def test_pictures_that_are_none_or_too_large_are_refused(client, tmp_path):
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "bomb.png").write_bytes(bomb(int(MAX_PIXELS**0.5) + 800))
    (tmp_path / "huge.png").write_bytes(bomb(20_000))
    for name, said in [("text", "not a picture"), ("bomb", "64 million"), ("huge", "64 million")]:
        with pytest.raises(AppError, match=said):
            client.predict(handle_file(tmp_path / f"{name}.png"), None, api_name="/cut_out")


def test_no_path_and_no_address_of_a_client_is_opened(client, picture, tmp_path):
    secret = tmp_path / "secret.png"
    secret.write_bytes(picture.read_bytes())
    for path in (str(secret), "/etc/passwd", "../../../etc/passwd", "file:///etc/passwd"):
        assert "it was not uploaded by a user" in posted(client, path), path
    assert "addresses are not fetched" in posted(client, "http://192.0.2.1/a.png")


def posted(client: Client, path: str) -> str:
    """What the server says to a picture of this path; the client of Gradio would upload the file."""
    data = json.dumps({"data": [{"path": path, "meta": {"_type": "gradio.FileData"}}, None]}).encode()
    address = f"{client.src}gradio_api/call/cut_out"
    request = urllib.request.Request(address, data, {"Content-Type": "application/json"})
    event = json.loads(urllib.request.urlopen(request, timeout=20).read())["event_id"]
    return urllib.request.urlopen(f"{address}/{event}", timeout=20).read().decode()


def test_a_request_that_is_too_large_is_not_read(client):
    request = urllib.request.Request(f"{client.src}gradio_api/queue/join", b"{}", {"Content-Type": "application/json"})
    request.add_unredirected_header("Content-Length", str(MOST_BODY_BYTES + 1))
    with pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(request, timeout=10)
    assert caught.value.code == 413


# Anything at all

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inside: st.lists(inside, max_size=3) | st.dictionaries(st.text(max_size=8), inside, max_size=3),
    max_leaves=6,
)
NEARLY_PARAMS = st.fixed_dictionaries({}, optional={name: JSON | st.just(TRUTH[name]) for name in BOX.names})


@st.composite
def pictures(draw) -> bytes:
    """Real picture files, some of them damaged, and bytes that are none."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=200))
    height, width = draw(st.integers(1, 90)), draw(st.integers(1, 90))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pixels = np.full((height, width, 4), rng.integers(0, 256, 4), np.uint8)
    pixels[height // 4 : -height // 4, width // 4 : -width // 4] = rng.integers(0, 256, 4)
    pixels[rng.random((height, width)) < draw(st.sampled_from([0, 0.02, 0.5]))] = rng.integers(0, 256, 4)
    mode = draw(st.sampled_from(["RGBA", "RGB", "L", "1", "P", "LA", "CMYK", "I;16", "F"]))
    kind = draw(st.sampled_from(["PNG", "JPEG", "WEBP", "GIF", "BMP", "TIFF"]))
    file = io.BytesIO()
    try:
        converted = Image.fromarray(pixels).convert(mode if mode != "I;16" else "I")
        (converted if mode != "I;16" else converted.convert("I;16")).save(file, kind)
    except (OSError, ValueError):  # not every format has every mode
        Image.fromarray(pixels).save(file, "PNG")
    content = bytearray(file.getvalue())
    for place in draw(st.lists(st.integers(0, len(content) - 1), max_size=3)):
        content[place] = draw(st.integers(0, 255))
    return bytes(content[: draw(st.sampled_from([len(content), len(content), len(content) // 2]))])


def answer(work: Callable[..., T], *asked: Any) -> T | None:
    """The result, or nothing after a sentence."""
    try:
        return work(*asked)
    except ValueError as error:
        words = str(error)
    assert len(words) > 10
    assert words[-1] in ".?"
    return None


@settings(max_examples=CASES)
@given(pictures(), st.none() | st.floats(0, 100))
def test_any_bytes_are_cut_out_or_refused_in_a_sentence(content, difference):
    cut = answer(app_actions.answer_cut_out, content, difference)
    assert cut is None or (cut[..., 3] > 32).any()


@settings(max_examples=CASES)
@given(params=NEARLY_PARAMS | JSON, suffix=st.sampled_from([".json", ".json", ".exe"]) | st.text(max_size=5))
def test_any_parameters_are_written_or_refused_in_a_sentence(studio, tmp_path_factory, params, suffix):
    folder = tmp_path_factory.getbasetemp()
    made = answer(app_actions.write, studio, folder, "box", params, ".json" if suffix in FORMATS else suffix)
    written = params_from_json(made.read_text())[1] if made else TRUTH
    assert BOX.validate(written) == written


@settings(max_examples=max(4, CASES // 40))
@given(content=pictures(), keep=NEARLY_PARAMS, seed=st.integers(0, 2**31))
def test_any_request_for_an_estimate_gets_candidates_or_a_sentence(studio, content, keep, seed):
    found = answer(app_actions.answer_estimate, studio, content, "box", 1, seed, keep)
    assert found is None or BOX.validate(found["candidates"][0]["params"])
