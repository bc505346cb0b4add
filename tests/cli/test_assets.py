"""Commands that write assets: fewer faces, before and after, a folder of pictures."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from dipcg.cli import main
from dipcg.config import ModelConfig
from dipcg.generators import load_generator
from dipcg.inference.preview import SIDE
from dipcg.model.checkpoint import save_checkpoint
from dipcg.model.estimators import Estimator

TINY = ModelConfig(width=16, depth=1, heads=2, summary=16)


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def untrained(tmp_path) -> Path:
    torch.manual_seed(0)
    box = load_generator("box")
    save_checkpoint(tmp_path / "checkpoint", Estimator(box.space, TINY), box, {})
    return tmp_path / "checkpoint"


def run(*words: object) -> int:
    try:
        main([str(word) for word in words])
    except SystemExit as end:
        return end.code
    return 0


def write_ball(folder: Path) -> Path:
    ball = "import trimesh\nfrom dipcg.space import ParameterSpace, Real\nspace = ParameterSpace(Real('r', 1.0, 2.0))\n"
    ball += "def build(params): return trimesh.creation.icosphere(subdivisions=4, radius=params['r'])\n"
    (folder / "ball.py").write_text(ball)
    return folder / "ball.py"


@pytest.mark.slow
def test_fewer_faces_are_written_when_asked_for(tmp_path):
    ball = write_ball(tmp_path)
    assert run("sample", ball, "-o", "full.stl") == run("sample", ball, "-o", "small.stl", "--faces", 300) == 0
    assert len(trimesh.load("full.stl").faces) == 5120
    assert 200 < len(trimesh.load("small.stl").faces) <= 300


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--faces", 2), "4 or more, got 2."),
        (("--texture", 512), ".stl files hold no maps; use one of .glb, .gltf, .usdz, .usd, .usda, .usdc."),
    ],
)
def test_what_cannot_be_written_so_is_refused(capsys, tmp_path, words, expected):
    assert run("sample", write_ball(tmp_path), "-o", "a.stl", *words) == 1
    assert expected in capsys.readouterr().err
    assert not Path("a.stl").exists()


@pytest.mark.slow
def test_levels_of_detail_and_hulls_are_written_and_nothing_is_lost_for_them(capsys, tmp_path):
    ball = write_ball(tmp_path)
    assert run("sample", ball, "-o", "a.glb", "--lods", 2, "--collision", "unreal") == 0
    scenes = [trimesh.load(name).geometry for name in ("a.glb", "a_LOD1.glb", "a_LOD2.glb")]
    assert [sorted(scene) for scene in scenes] == [["UCX_body_01", "body"], ["body"], ["body"]]
    counts = [len(scene["body"].faces) for scene in scenes]
    assert counts[0] >= counts[1] > counts[2]
    assert run("sample", ball, "-o", "b.stl", "--collision", "unreal") == 1
    assert "Game engines read hulls from .glb" in capsys.readouterr().err
    Path("c_LOD1.glb").write_text('{"generator": "ball.py", "params": {"r": 1.0}}')
    assert run("edit", "c_LOD1.glb", "-o", "c.glb", "--lods", 1) == 1
    assert "c_LOD1.glb would be overwritten" in capsys.readouterr().err


@pytest.mark.slow
def test_painted_parts_have_their_colours_which_the_parameters_keep(capsys, tmp_path):
    ball = write_ball(tmp_path)
    assert run("sample", ball, "-o", "a.glb", "--params-out", "a.json", "--paint", "body=#33CC00") == 0
    (body,) = trimesh.load("a.glb").geometry.values()
    # Linear light of 0.2 and 0.8 in sRGB.
    np.testing.assert_allclose(np.array(body.visual.material.baseColorFactor[:3]) / 255, [0.033, 0.604, 0], atol=0.003)
    assert json.loads(Path("a.json").read_text())["colours"] == {"body": [0.2, 0.8, 0.0]}
    assert "no part" not in capsys.readouterr().err
    again = run("edit", "a.json", "-o", "b.glb", "--params-out", "b.json", "--paint", "body=#ff0000", "lid=#000000")
    assert again == 0
    assert json.loads(Path("b.json").read_text())["colours"]["body"] == [1.0, 0.0, 0.0]
    assert "The asset has no part lid, only body." in capsys.readouterr().err
    assert run("sample", ball, "-o", "c.glb", "--paint", "body=red") == 1
    assert "written as in seat=#b51f1a, got body=red" in capsys.readouterr().err


@pytest.mark.slow
def test_a_failed_build_is_printed_with_what_edit_needs_to_repeat_it(capsys, tmp_path):
    text = write_ball(tmp_path).read_text().replace("return trimesh", "raise ValueError('too round') or trimesh")
    Path("ball.py").write_text(text)
    assert run("sample", "ball.py", "-o", "a.stl", "--set", "r=1.5") == 1
    printed = capsys.readouterr().err
    assert printed.startswith("The generator raised ValueError: too round (ball.py, line 4). `dipcg edit`")
    Path("ball.json").write_text(printed[printed.index("{") :])
    assert run("edit", "ball.json", "-o", "a.stl") == 1
    assert capsys.readouterr().err == printed


@pytest.mark.slow
def test_an_edit_is_drawn_before_and_after_on_one_scale(tmp_path):
    ball = write_ball(tmp_path)
    run("sample", ball, "-o", "a.stl", "--params-out", "a.json", "--set", "r=1")
    assert run("edit", "a.json", "--set", "r=2", "-o", "b.stl", "--preview", "both.png") == 0
    both = np.array(Image.open("both.png"))[..., :3].astype(int)
    assert both.shape == (SIDE, 2 * SIDE, 3)
    # The plastic of the ball is bluish, its shadow is not.
    before, after = ((half[..., 2] > half[..., 0] + 1).sum() for half in (both[:, :SIDE], both[:, SIDE:]))
    assert after / before == pytest.approx(4, rel=0.1), "twice the radius, four times the picture, and a little nearer"


@pytest.mark.slow
def test_an_edit_keeps_the_colours_of_the_photo(untrained):
    pixels = np.full((48, 48, 3), 255, np.uint8)
    pixels[12:36, 14:34] = [200, 20, 20]
    Image.fromarray(pixels).save("red.png")
    words = ("estimate", "red.png", "-g", untrained, "-o", "a.glb", "--params-out", "a.json")
    assert run(*words, "--candidates", 1, "--steps", 1) == 0
    document = json.loads(Path("a.json").read_text())
    assert all(red > 3 * max(green, blue) for red, green, blue in document["colours"].values())
    edit = ("edit", "a.json", "--set", "has_legs=1", "leg_height=0.3", "-o")
    assert run(*edit, "b.glb") == run(*edit, "c.glb", "--colours", "material") == 0
    legs = [trimesh.load(name).geometry["leg"].visual.material.baseColorFactor for name in ("b.glb", "c.glb")]
    assert legs[0][0] > 3 * legs[0][1]
    assert legs[1][0] < 1.5 * legs[1][1]
    Path("a.json").write_text(json.dumps(document | {"colours": {"leg": "red"}}))
    assert run(*edit, "d.glb") == 1


def test_a_folder_is_worked_through_and_a_second_run_does_what_is_missing(capsys, untrained):
    Path("in").mkdir()
    pixels = np.full((48, 48, 3), 255, np.uint8)
    pixels[12:36, 14:34] = 90
    for name in ("a", "b"):
        Image.fromarray(pixels).save(f"in/{name}.png")
    Path("in/broken.png").write_bytes(b"no picture")
    words = ("estimate", "in", "-g", untrained, "-o", "out/", "--candidates", 1, "--steps", 1)
    assert run(*words) == 1
    assert {path.name for path in Path("out").iterdir()} == {"index.html"} | {
        f"{name}{ending}" for name in ("a", "b") for ending in (".glb", ".json", ".preview.png")
    }
    page = Path("out/index.html").read_text()
    assert "2 of 3 pictures, 1 failed" in page
    assert "broken.png" in page
    assert json.loads(Path("out/a.json").read_text())["generator"] == "box"

    Path("in/broken.png").unlink()
    Path("out/b.preview.png").unlink()
    kept = Path("out/a.glb").stat().st_mtime_ns
    capsys.readouterr()
    assert run(*words) == 0
    assert "1 of 2 pictures wait" in capsys.readouterr().err
    assert Path("out/a.glb").stat().st_mtime_ns == kept
    assert "2 of 2 pictures" in Path("out/index.html").read_text()


def test_previews_of_a_folder_are_not_to_be_named(capsys, untrained):
    Path("in").mkdir()
    Image.new("RGB", (8, 8)).save("in/a.png")
    assert run("estimate", "in", "-g", untrained, "-o", "out/", "--preview", "p.png") == 1
    assert "always written" in capsys.readouterr().err
