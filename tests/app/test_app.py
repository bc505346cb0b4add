"""The app without a server: what visitors can do to their work, what they get for it, and which files."""

import base64
import io
import json
import os
import shlex
import shutil
import time

import numpy as np
import pytest
import trimesh
from boxes import BOX, TRUTH, VIEW
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from serving import OPEN

from dipcg import registry
from dipcg.app import actions as app_actions
from dipcg.app import state as app_work
from dipcg.app.panel import rows
from dipcg.app.state import Work
from dipcg.app.viewer import scene
from dipcg.cli import main
from dipcg.generators import load_generator
from dipcg.inference.estimate import Options
from dipcg.space import Real, params_from_json

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


@settings(max_examples=30)
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
    shares = []
    options = Options(generator="box", candidates=3)
    found = studio.estimate(picture, options, report=lambda share, words: shares.append(share)).estimate
    expected = studio.inverters["box"].estimate(picture, candidates=3)
    assert 1 < len(found.candidates) <= 3
    assert all(c.params in [e.params for e in expected.candidates] for c in found.candidates)
    assert all(c.mesh is not None for c in found.candidates)
    assert shares == sorted(shares)
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

    options = Options(generator="box", candidates=2)
    undisturbed = studio.estimate(picture, options).estimate
    found = studio.estimate(picture, options, report=kill).estimate
    assert [c.params for c in found.candidates] == [c.params for c in undisturbed.candidates]
    for child in list(studio.inverters["box"].pool._children):
        child._process.kill()
    assert len(studio.build("box", TRUTH).mesh.faces) > 0


def test_held_values_stay_when_the_rest_is_estimated_again(studio, picture):
    fixed = {"width": 0.35, "top": "pyramid"}
    found = studio.estimate(picture, Options(generator="box", candidates=2, seed=3, fixed=fixed)).estimate
    assert {(c.params["width"], c.params["top"]) for c in found.candidates} == {(0.35, "pyramid")}


def test_words_become_candidates_with_meshes_around_what_is_held(studio):
    pytest.importorskip("transformers")
    options = Options(generator="box", candidates=3, fixed={"width": 0.35})
    found = studio.describe("a low box with legs", options).estimate
    assert {c.params["width"] for c in found.candidates} == {0.35}
    assert all(c.mesh is not None and c.agreement is None for c in found.candidates)
    assert len({c.view for c in found.candidates}) == 1, "all from one side"
    strip = app_actions.strip(studio, found)
    assert "picture" not in strip
    assert len(strip["candidates"]) == len(found.candidates)
    change, _ = app_actions.estimate(studio, "a low box with legs", "", {}, 0, lambda share, words: None)
    assert change(Work()).asked == "a low box with legs"


@pytest.mark.parametrize("text", ["", "  ", "ein hölzerner Stuhl mit geschwungener Rückenlehne", "box " * 400])
def test_words_that_cannot_be_read_get_a_sentence(studio, text):
    pytest.importorskip("transformers")
    with pytest.raises(ValueError, match="The text"):
        studio.describe(text, Options(generator="box", candidates=2))


def test_a_scene_holds_the_surface_it_was_made_of(mesh):
    made = scene(mesh, VIEW, 1)
    vertices = np.frombuffer(base64.b64decode(made["vertices"]), "<f4").reshape(-1, 3)
    faces = np.frombuffer(base64.b64decode(made["faces"]), "<u4").reshape(-1, 3)
    assert trimesh.Trimesh(vertices, faces).area == pytest.approx(trimesh.Trimesh(mesh.vertices, mesh.faces).area)
    assert [part["first"] for part in made["parts"]] == np.cumsum(
        [0, *(p["count"] for p in made["parts"][:-1])]
    ).tolist()
    assert sum(part["count"] for part in made["parts"]) == faces.size


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
