"""Blender files as generators: every kind of input, nothing in them runs, a sentence for what cannot be used."""

import json
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import zstandard

from dipcg.blender.declaration import write_declaration
from dipcg.cli import main
from dipcg.export.blend import write_live
from dipcg.generators import load_generator
from dipcg.importing.blend import Options, import_blend
from dipcg.space import Choice, Real
from dipcg.workers.pool import BuildPool

HERE = Path(__file__).parent
LAMP = HERE.parents[1] / "examples" / "lamp.blend"

pytestmark = [pytest.mark.blender, pytest.mark.skipif(find_spec("bpy") is None, reason="bpy not installed")]


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("blends")
    subprocess.run([sys.executable, HERE / "make_blends.py", folder], check=True, capture_output=True)
    return folder


@pytest.fixture
def blends(made, tmp_path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "blends"))


def built(toml: Path, *settings: dict) -> list:
    """Meshes of the first parameters of the space, changed."""
    generator = load_generator(str(toml))
    start = generator.space.sample(np.random.default_rng(0))
    with BuildPool(str(toml)) as pool:
        return [pool.build(generator.space.replace(start, change)) for change in settings]


def sentence(capsys, *words: object) -> str:
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    out, err = capsys.readouterr()
    assert (end.value.code, out) == (1, "")
    assert err.count("\n") == 1, err
    assert "Traceback" not in err
    return err.strip()


# What becomes of the inputs

RANGES = {"size_2": "0:1", "Turn": "-90:90"}


def test_every_kind_of_input_becomes_what_a_person_would_expect(blends):
    ranges = RANGES | {"Shift": "-0.5:0.5", "shift_z": "0:1"}
    found = import_blend(blends / "kinds.blend", Options(ranges=ranges))
    space = load_generator(str(found.path)).space
    assert space.names == found.parameters
    size, turn, many = space["size"], space["turn_x"], space["many"]
    assert isinstance(size, Real)
    assert (size.low, size.high, size.unit, size.default) == (1, 2, "m", 1.5)
    assert isinstance(turn, Real)
    assert (turn.low, turn.high, turn.unit) == (pytest.approx(-90), pytest.approx(90), "°")
    assert isinstance(space["few"], Choice)
    assert space["few"].options == (2, 3, 4, 5)
    assert isinstance(many, Real)
    assert (many.low, many.high) == (1, 100)
    limits = [(space[name].low, space[name].high) for name in ("shift_x", "shift_z", "turn_y")]
    assert limits == [(-0.5, 0.5), (0, 1), (-90, 90)]
    assert set(found.left_out) == {"Fixed", "Hidden", "Note", "Other", "size", "Höhe!", "2nd Turn", "Shown"}
    assert found.left_out["Höhe!"] == "it changes nothing in any trial"


def test_inputs_reach_the_graph_in_their_own_units(blends):
    toml = import_blend(blends / "kinds.blend", Options(ranges=RANGES)).path
    still = {"size": 1.0, "turn_x": 0, "turn_y": 0, "turn_z": 0, "shift_x": 0, "shift_y": 0, "shift_z": 0}
    still |= {"few": 2, "many": 2}
    plain, large, moved, turned, fine = built(
        toml, still, still | {"size": 2.0}, still | {"shift_y": 0.5}, still | {"turn_z": 45}, still | {"many": 40.4}
    )
    assert (plain.side, large.side) == (pytest.approx(1), pytest.approx(2))
    np.testing.assert_allclose(moved.centre, [0, 0.5, 0], atol=1e-6)
    assert turned.side == pytest.approx(2**0.5)
    assert len(np.unique(fine.vertices[:, 1].round(4))) == 40, "a large integer is rounded"


def test_menus_materials_and_panels_come_from_the_file():
    generator = load_generator(str(LAMP.with_suffix(".toml")))
    assert generator.space["shade"].options == ("Cone", "Dome", "Globe")
    assert {p.group for p in generator.space} == {"Base", "Stem", "Shade"}
    globe, cone = built(LAMP.with_suffix(".toml"), {"shade": "Globe", "lean": 0}, {"shade": "Cone", "lean": 0})
    assert set(globe.part_names) == set(cone.part_names) == {"base", "stem", "shade"}
    assert len(globe.faces) != len(cone.faces)


def test_instances_become_faces_and_the_object_names_what_has_no_material(blends):
    small, large = built(import_blend(blends / "instances.blend").path, {"size": 1.0}, {"size": 2.0})
    assert set(small.part_names) == {"red", "Row"}
    assert len(small.faces) == 4 * 12
    assert (small.side, large.side) == (pytest.approx(5), pytest.approx(6))


def test_what_blender_draws_without_faces_is_named_and_left_out(blends):
    made = import_blend(blends / "mixed.blend")
    assert made.notes == [
        "'Mixed' also has curves (Curve to Mesh) and points (Instance on Points), left out until the node in brackets "
        "gives them faces."
    ]
    (mesh,) = built(made.path, {"size": 1.5})
    assert len(mesh.faces) == 12


def test_a_curve_with_a_bevel_is_a_surface(blends):
    small, large = built(import_blend(blends / "bevelled.blend").path, {"size": 1.0}, {"size": 2.0})
    assert (small.side, large.side) == (pytest.approx(2.2, abs=0.01), pytest.approx(4.4, abs=0.02))


def test_what_is_hidden_in_the_file_is_built_where_it_stands(blends):
    (mesh,) = built(import_blend(blends / "unseen.blend").path, {"size": 1.0})
    np.testing.assert_allclose(mesh.bounds, [[-0.5, -1, 4.5], [0.5, 1, 5.5]], atol=1e-6)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] - mesh.centre for i in range(3))
    assert (np.einsum("ij,ij->i", a, np.cross(b, c)) > 0).all(), "a mirrored object has its faces outwards"


def test_two_processes_build_the_same_whatever_they_built_before():
    toml = LAMP.with_suffix(".toml")
    many = [{"shade": shade, "rings": rings} for shade in ("Cone", "Dome", "Globe") for rings in (0, 3)]
    for mesh, again in zip(built(toml, *many), built(toml, *many[::-1])[::-1], strict=True):
        np.testing.assert_array_equal(mesh.vertices, again.vertices)
        np.testing.assert_array_equal(mesh.faces, again.faces)
        np.testing.assert_array_equal(mesh.parts, again.parts)


# Limits


def test_what_has_no_limits_gets_a_range_with_a_reason(capsys, blends):
    main(["generators", "add", str(blends / "kinds.blend"), "--hold", "Shift", "--json"])
    made = json.loads(capsys.readouterr().out)
    assert made["parameters"]["turn_z"] == {
        "name": "turn_z", "value": "0", "range": "-45 to 45", "why": "a tilt to either side"
    }  # fmt: skip
    assert made["left_out"]["Shift x"] == "held at its value, as you said"
    assert 'why = "a tilt to either side"' in (blends / "kinds.toml").read_text()
    assert "shift_x" not in load_generator(str(blends / "kinds.toml")).space


def test_ranges_are_asked_for_and_an_empty_answer_takes_the_proposal(blends):
    asked = []
    answers = {"Turn y": "0:10", "Turn z": " "}
    ask = Options(ask=lambda question: asked.append(question) or answers.get(question.split(" is")[0], ""))
    space = load_generator(str(import_blend(blends / "kinds.blend", ask).path)).space
    assert [question.split(" is")[0] for question in asked] == ["size", "Turn x", "Turn y", "Turn z"]
    assert asked[1] == "Turn x is 0 in ° and has no limits. Lowest:highest (-45:45)? "
    assert [(space[name].low, space[name].high) for name in ("turn_x", "turn_y")] == [(-45, 45), (0, 10)]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("Size=0:1.5", "The range of Size must rise and lie between 1 and 2 in m, got 0:1.5."),
        ("Size=2:1", "The range of Size must rise"),
        ("Size=1", "A range is written name=low:high, like Size=0.1:0.5, got '1'."),
        ("Size=low:high", "A range is written name=low:high"),
        ("Siez=1:2", "There is no input 'Siez'"),
        ("Shown=0:1", "Shown is a boolean and has no range."),
        ("Size", "A setting is written name=value, got 'Size'."),
    ],
)
def test_a_wrong_range_is_named(capsys, blends, given, expected):
    assert expected in sentence(capsys, "generators", "add", blends / "kinds.blend", "--range", given)


# Files that cannot be used


@pytest.mark.parametrize(
    ("name", "words", "expected"),
    [
        ("two.blend", [], "has several objects with Geometry Nodes: First, Second. Name one with --object."),
        ("two.blend", ["--object", "Frist"], "has no object 'Frist'. Did you mean 'First'?"),
        ("two.blend", ["--object", "Empty"], "The object 'Empty'"),
        ("plain.blend", [], "has a Geometry Nodes modifier"),
        ("curve.blend", [], "'Ring' has no faces"),
        ("unlinked.blend", [], "has no faces. Curves and points alone are no surface: give them some"),
        ("no_inputs.blend", [], "no input of 'Box' can be a parameter (Note: string inputs are not parameters"),
        ("picture_beside.blend", [], "height.png. In Blender, make it local"),
        ("baked.blend", [], "'Box' in {folder}/baked.blend needs //bakes. In Blender, make it local"),
        ("cloth.blend", [], "needs the cache of its modifier 'cloth'"),
        ("smoking.blend", [], "needs the cache of its modifier 'smoke'"),
        ("sequence.blend", [], "height.png. In Blender, make it local"),
        ("sculpted.blend", [], "detail.btx. In Blender, make it local"),
        ("volume.blend", [], "cloud.vdb. In Blender, make it local"),
        ("through.blend", [], "'Box' in {folder}/through.blend needs //other.mdd. In Blender, make it local"),
        ("linked.blend", [], "needs the geometry node tree 'tree' of //kinds.blend"),
        ("missing.blend", [], "There is no file"),
        ("text.blend", [], "text.blend is not a Blender file"),
        ("empty.blend", [], "empty.blend is not a Blender file"),
        ("header.blend", [], "header.blend"),
        ("half.blend", [], "half.blend"),
        ("end.blend", [], "end.blend"),
    ],
)
def test_a_file_that_cannot_be_used_gets_a_sentence(capsys, blends, name, words, expected):
    (blends / "text.blend").write_text("a lamp, roughly")
    (blends / "empty.blend").touch()
    lamp = LAMP.read_bytes()
    for part, share in (("header", 0.001), ("half", 0.5), ("end", 0.99)):
        (blends / f"{part}.blend").write_bytes(lamp[: int(share * len(lamp))])
    assert expected.replace("{folder}", str(blends)) in sentence(capsys, "generators", "add", blends / name, *words)
    assert list(blends.glob("*.toml")) == []


def test_a_bake_that_is_gone_is_not_needed(blends):
    (blends / "bakes").rmdir()
    assert import_blend(blends / "baked.blend").parameters


def test_blender_that_stops_hangs_or_is_missing_gets_a_sentence(capsys, blends, monkeypatch):
    add = ["generators", "add", blends / "instances.blend"]
    with monkeypatch.context() as patch:
        patch.setattr("dipcg.workers.process.sys.executable", shutil.which("false"))
        assert "The worker process died (exit code 1)." in sentence(capsys, *add)
    with monkeypatch.context() as patch:
        patch.setattr("dipcg.importing.blend.TIMEOUT_S", 0.01)
        assert "took longer than 0.01 s" in sentence(capsys, *add)
    with monkeypatch.context() as patch:
        patch.setattr("dipcg.workers.rpc.find_spec", lambda name: None)
        assert "Blender's module is missing: run `pip install" in sentence(capsys, *add)


def test_one_of_several_objects_is_chosen_by_name(blends):
    assert import_blend(blends / "two.blend", Options(object="Second")).parameters == ["size"]


def test_nothing_in_the_file_runs(blends, made):
    found = import_blend(blends / "trap.blend")
    assert any("Python drivers" in note and note.endswith("would set location.") for note in found.notes)
    (mesh,) = built(found.path, {"size": 1.0})
    assert mesh.side == pytest.approx(1)
    assert not list(made.glob("*-ran"))
    with_scripts = f"import bpy; bpy.ops.wm.open_mainfile(filepath={str(blends / 'trap.blend')!r}, use_scripts=True)"
    look = "; bpy.context.view_layer.update(); import os; os._exit(0)"
    subprocess.run([sys.executable, "-c", with_scripts + look], check=True, capture_output=True)
    assert {path.name for path in made.glob("*-ran")} == {"text-ran", "driver-ran"}, "the trap works"
    for path in made.glob("*-ran"):
        path.unlink()


def test_nothing_is_evaluated_before_it_was_checked(blends):
    """Smoke is written into any folder that a file names as soon as its scene is evaluated, which opening it does."""
    with pytest.raises(ValueError, match="needs the cache"):
        import_blend(blends / "smoking.blend")
    found = import_blend(blends / "smoke.blend")
    write_live(str(found.path), {"size": 1.0}, blends / "saved.blend")
    assert not (blends / "written").exists()
    look = f"import bpy; bpy.ops.wm.open_mainfile(filepath={str(blends / 'saved.blend')!r})"
    look += "; bpy.context.view_layer.update()"
    end = "; assert bpy.context.scene.objects.keys() == ['Box', 'Smoke'], bpy.data.scenes[:]; import os; os._exit(0)"
    subprocess.run([sys.executable, "-c", look + end], check=True, capture_output=True)
    assert (blends / "written").exists(), "the smoke works"


def test_no_file_is_packed_into_what_is_saved(blends, made):
    """Who fetches the Blender file of an asset would get any file of the server that the source names."""
    found = import_blend(blends / "hoarder.blend")
    (made / "secret.txt").write_text("the secret")
    write_live(str(found.path), {"size": 1.0}, blends / "saved.blend")
    (made / "secret.txt").unlink()
    with (blends / "saved.blend").open("rb") as file:
        content = zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True).read()
    assert b"secret.txt" in content
    assert b"the secret" not in content


def test_pictures_of_materials_are_read_by_nothing(blends, made):
    (mesh,) = built(import_blend(blends / "pixels.blend").path, {"size": 1.0})
    assert (made / "white.png").is_file()
    assert mesh.centre == pytest.approx(0)


# The file that is written


def test_an_existing_file_is_not_overwritten(capsys, blends):
    shutil.copy(LAMP, blends)
    (blends / "lamp.toml").write_text("mine")
    assert "is there already" in sentence(capsys, "generators", "add", blends / "lamp.blend")
    assert (blends / "lamp.toml").read_text() == "mine"
    assert "must end in .toml" in sentence(capsys, "generators", "add", LAMP, "-o", blends / "lamp.txt")


def test_the_file_may_lie_elsewhere_and_both_may_be_moved(blends, tmp_path, monkeypatch):
    (tmp_path / "generators").mkdir()
    found = import_blend(blends / "instances.blend", output=tmp_path / "generators" / "row.toml")
    assert 'blend = "../blends/instances.blend"' in found.path.read_text()
    moved = shutil.move(tmp_path / "generators", tmp_path / "blends" / "own")
    shutil.move(blends / "instances.blend", blends / "own" / "instances.blend")
    text = (Path(moved) / "row.toml").read_text()
    (Path(moved) / "row.toml").write_text(text.replace("../blends/", ""))
    monkeypatch.chdir(moved)
    assert load_generator("./row.toml").ref == "row.toml"
    assert len(built(Path("row.toml"), {"size": 1.0})) == 1


def test_a_changed_or_lost_blender_file_gets_a_sentence(capsys, blends):
    toml = import_blend(blends / "instances.blend").path
    shutil.copy(blends / "unseen.blend", blends / "instances.blend")
    said = sentence(capsys, "sample", toml, "-o", blends / "row.glb")
    assert "instances.blend has changed since this file was written" in said
    new = said[said.index('sha256 = "') : said.rindex('"') + 1]
    old = next(line for line in toml.read_text().splitlines() if line.startswith("sha256"))
    toml.write_text(toml.read_text().replace(old, new).replace('"Row"', '"Box"'))
    assert len(built(toml, {"size": 1.0})) == 1, "and its advice helps"
    (blends / "instances.blend").unlink()
    assert "instances.blend is not there" in sentence(capsys, "sample", toml, "-o", blends / "row.glb")


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("high = 2", "high = ", "Invalid value (at line"),
        ("high = 2", "high = 1", "size: low must be below high, got 1.0 and 1.0."),
        ("high = 2", "", "size: `low` and `high` must be numbers, got 1 and None."),
        ("high = 2", "hihg = 2", "size has an unknown key 'hihg'. Did you mean 'high'?"),
        ('kind = "real"', 'kind = "reel"', "size: the kind is one of real, integer, boolean, menu, got 'reel'."),
        ('kind = "real"', 'kind = "menu"', "size: a choice needs at least two different options"),
        ('kind = "real"', "", "size lacks kind"),
        ("[parameters.size]", '[parameters."a size"]', "a parameter's name is made of letters"),
        ("default = 1.5", "default = 9", "size: the default 9.0 is not from 1.0 to 2.0."),
        ('object = "Row"', "", "the file lacks object"),
        ("high = 2", 'high = 2\nwhen = { shape = ["a"] }', "size: `when` must name a choice"),
    ],
)
def test_a_broken_declaration_names_the_file_and_the_fault(capsys, blends, before, after, expected):
    toml = import_blend(blends / "instances.blend").path
    assert before in toml.read_text()
    toml.write_text(toml.read_text().replace(before, after))
    said = sentence(capsys, "sample", toml, "-o", blends / "row.glb")
    assert said.startswith(str(toml))
    assert expected in said


def test_an_input_that_is_not_there_fails_one_build(capsys, blends):
    toml = import_blend(blends / "instances.blend").path
    toml.write_text(toml.read_text().replace('input = "Socket_1"', 'input = "Socket_7"'))
    assert "The modifier has no input 'Socket_7'" in sentence(capsys, "sample", toml, "-o", blends / "row.glb")


def test_names_and_docs_of_any_letters_survive(tmp_path):
    shutil.copy(LAMP, tmp_path)
    shipped = LAMP.with_suffix(".toml").read_text()
    digest = next(line.split('"')[1] for line in shipped.splitlines() if line.startswith("sha256"))
    odd = 'quotes " and \\ and \n, \x7f, 🪔, ]'
    entry = {"input": "Socket_17", "kind": "real", "low": 0.1, "high": 0.2}
    entry |= dict.fromkeys(("doc", "unit", "group"), odd)
    top = {"doc": odd, "blend": "lamp.blend", "object": "Lamp", "sha256": digest}
    path = tmp_path / "odd.toml"
    path.write_text(write_declaration(top, {"größe": entry}, path), encoding="utf-8")
    generator = load_generator(str(path))
    (parameter,) = generator.space
    assert (parameter.name, parameter.doc, parameter.unit, parameter.group) == ("größe", odd, odd, odd)
    assert generator.doc == odd


def test_a_packed_picture_shapes_the_object_and_no_other_file_is_read(made, blends):
    found = import_blend(blends / "picture_packed.blend")
    (before,) = built(found.path, {})
    # The picture's path in the file is that of the folder where the file was made.
    (made / "height.png").write_bytes(b"no picture")
    (blends / "wood.png").write_bytes(b"no picture")
    (after,) = built(found.path, {})
    np.testing.assert_array_equal(before.vertices, after.vertices)
