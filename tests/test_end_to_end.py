"""The whole path on the toy: data, training, estimates from pictures, editing, measuring; and going on after a kill."""

import io
import json
import math
import shutil
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from safetensors.numpy import load_file

from dipcg.cli import main
from dipcg.data.store import Store
from dipcg.generators import load_generator
from dipcg.images import MARGIN, save_image
from dipcg.inference.rank import rank
from dipcg.pipeline import Inverter
from dipcg.render import Renderer

SPACE = load_generator("box").space
# Three of them are in the test split.
COUNT = 60


def dipcg(*words: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of one command, in this process."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main([str(word) for word in words])
        except SystemExit as end:
            code = end.code
    return code, out.getvalue(), err.getvalue()


def succeed(*words: object) -> str:
    code, out, err = dipcg(*words)
    assert code == 0, err
    return out


def estimated(*words: object) -> list[dict]:
    return [json.loads(line) for line in succeed("estimate", *words, "--json").splitlines()]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "box"
    assert f"{COUNT} shapes in {folder}, 0 failed." in succeed(
        "dataset", "build", "box", "-o", folder, "--count", COUNT
    )
    return folder


@pytest.fixture(scope="module")
def pictures(data, tmp_path_factory) -> list[Path]:
    """Pictures of unseen boxes."""
    folder, renderer, rng = tmp_path_factory.mktemp("pictures"), Renderer(128), np.random.default_rng(0)
    views = load_generator("box").views
    paths = []
    for sample in Store(data).samples("test"):
        paths.append(folder / f"box{sample.number}.png")
        save_image(np.ascontiguousarray(renderer.render(sample.mesh, views.sample(rng), margin=MARGIN)), paths[-1])
    renderer.close()
    return paths


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    dials = ["--pictures", "1500", "--image-size", "64", "--denoiser-share", "0.5", "--depth", "1", "--batch", "16"]
    assert f"-g {folder / 'box'}" in succeed("train", "box", "--data", data, "-o", folder, *dials)
    return folder / "box"


# Data


def test_a_data_set_says_what_it_holds(data):
    found = json.loads(succeed("dataset", "info", data, "--json"))
    assert (found["generator"], found["samples"], found["failed"]) == ("box", COUNT, {})
    assert found["splits"] == {"train": 54, "validation": 3, "test": 3}
    assert "samples       60" in succeed("dataset", "info", data)


def test_a_contact_sheet_has_a_tile_for_every_shape(data, tmp_path):
    succeed("dataset", "gallery", data, "-o", tmp_path / "sheet.png", "--count", 11)
    sheet = np.asarray(Image.open(tmp_path / "sheet.png"))
    tiles = sheet.reshape(2, 192, 8, 192, 3).swapaxes(1, 2).reshape(16, -1)
    assert [bool((tile < 255).any()) for tile in tiles] == [True] * 11 + [False] * 5


def test_building_again_changes_nothing(data):
    before = {path: path.read_bytes() for path in data.iterdir()}
    succeed("dataset", "build", "box", "-o", data, "--count", COUNT)
    assert {path: path.read_bytes() for path in data.iterdir()} == before
    code, _, err = dipcg("dataset", "build", "box", "-o", data, "--count", COUNT, "--no-resume")
    assert code == 1
    assert "already has shards" in err


# Training


def test_training_leaves_finite_weights_and_a_card(trained):
    card = json.loads((trained / "card.json").read_text())
    assert (card["generator"], card["fingerprint"]) == ("box", SPACE.fingerprint)
    assert card["model"]["depth"] == 1
    assert card["train"]["batch"] == 16
    assert card["pictures"] > 0
    assert all(math.isfinite(value) for value in card["validation"].values())
    assert all(np.isfinite(weight).all() for weight in load_file(trained / "model.safetensors").values())
    (line,) = (trained / "log.jsonl").read_text().splitlines()
    assert json.loads(line)["validation"] == card["validation"]


def test_training_on_the_shapes_of_another_generator_is_refused(data, tmp_path):
    code, _, err = dipcg("train", "chair", "--data", data, "-o", tmp_path)
    assert (code, err) == (1, f"{data} holds shapes of 'box', not of 'chair'.\n")


def test_a_finished_run_of_another_model_is_not_continued(data, trained):
    code, _, err = dipcg("train", "box", "--data", data, "-o", trained.parent, "--depth", 2)
    assert code == 1
    assert f"{trained} holds a run with other settings: batch was 16 and is 64" in err
    assert "depth was 1 and is 2" in err


TRAIN = """
import sys
from dipcg.training import train
from dipcg.config import ModelConfig, TrainConfig

data, out, pictures = sys.argv[1:]
train.VALIDATE_EVERY_S, train.VALIDATION_PICTURES, train.REPORT_EVERY = 0.5, 4, 1
dials = TrainConfig(pictures=int(pictures), batch=4, denoiser_share=0.5)
model = ModelConfig(image_size=32, width=24, depth=1, heads=2, summary=16)
train.train(data, out, dials, model, lambda status: print(status.pictures, flush=True))
"""


def test_a_killed_training_goes_on(data, tmp_path):
    before = pictures_when_killed(data, tmp_path)
    done = subprocess.run(training(data, tmp_path, before + 80), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    first, *_, last = map(int, done.stdout.splitlines())
    # A kill loses at most the pictures since the last validation.
    assert 4 < first <= before + 4
    assert last >= before + 80


def test_a_training_that_is_asked_to_end_saves_its_state(data, tmp_path):
    words = ["train", "box", "--data", data, "-o", tmp_path, "--depth", "1", "--batch", "8", "--image-size", "32"]
    child = subprocess.Popen([sys.executable, "-m", "dipcg", *words], stderr=subprocess.PIPE, text=True)
    # TensorBoard's file is made at the first report.
    while not list(tmp_path.glob("box/events*")) and child.poll() is None:
        time.sleep(0.1)
    child.terminate()
    assert "Stopped. The state is saved in" in child.communicate(timeout=60)[1]
    assert (tmp_path / "box" / "state.safetensors").is_file()


def pictures_when_killed(data: Path, out: Path) -> int:
    """The pictures seen by a training that was killed after it had saved its state."""
    child = subprocess.Popen(training(data, out, 1_000_000), stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    pictures = 0
    for line in child.stdout:
        pictures = int(line)
        if (out / "state.safetensors").exists():
            break
    child.send_signal(signal.SIGKILL)
    child.wait()
    return pictures


def training(data: Path, out: Path, pictures: int) -> list[str]:
    return [sys.executable, "-c", TRAIN, str(data), str(out), str(pictures)]


# Estimates


def test_each_picture_gets_a_mesh_parameters_and_a_preview(trained, pictures, tmp_path):
    outputs = ["-o", tmp_path / "a.glb", "--params-out", tmp_path / "a.json", "--preview", tmp_path / "a.png"]
    found = estimated(*pictures, "-g", trained, *outputs, "--candidates", 3, "--steps", 2)
    assert [row["image"] for row in found] == [str(path) for path in pictures]
    for row, picture in zip(found, pictures, strict=True):
        assert row["output"] == str(tmp_path / f"{picture.stem}.glb")
        assert len(row["candidates"]) == 3
        assert all(SPACE.validate(c["params"]) == c["params"] for c in row["candidates"])
        written = json.loads((tmp_path / f"{picture.stem}.json").read_text())
        assert written.keys() == {"generator", "params", "colours"}
        assert (written["generator"], written["params"]) == ("box", row["candidates"][0]["params"])
        width = written["params"]["width"] + 2 * (written["params"]["top"] != "open") * written["params"]["overhang"]
        assert trimesh.load(row["output"]).extents[0] == pytest.approx(width, abs=1e-4)
        assert Image.open(tmp_path / f"{picture.stem}.png").size == (3 * 384, 384)


def test_a_bad_picture_among_others_does_not_lose_them(trained, pictures, tmp_path):
    (tmp_path / "bad.png").write_bytes(b"")
    several = [pictures[0], tmp_path / "bad.png", tmp_path / "none.png", pictures[1]]
    code, out, err = dipcg(
        "estimate", *several, "-g", trained, "-o", tmp_path / "a.glb", "--candidates", 1, "--steps", 1
    )
    assert code == 1
    assert err.splitlines() == [
        f"{tmp_path / 'bad.png'} is empty (0 bytes).",
        f"There is no picture at {tmp_path / 'none.png'}.",
    ]
    assert sorted(path.name for path in tmp_path.glob("*.glb")) == [f"{picture.stem}.glb" for picture in pictures[:2]]
    assert len(out.splitlines()) == 2


def test_kept_values_are_held_in_every_candidate(trained, pictures, tmp_path):
    words = [pictures[0], "-g", trained, "-o", tmp_path / "a.glb", "--candidates", 8, "--steps", 2, "--no-rank"]
    (found,) = estimated(*words, "--keep", "width=0.35", "top=pyramid", "--keep", "has_legs=yes")
    for candidate in found["candidates"]:
        assert {name: candidate["params"][name] for name in ("width", "top", "has_legs")} == {
            "width": 0.35,
            "top": "pyramid",
            "has_legs": True,
        }
    assert len({candidate["params"]["depth"] for candidate in found["candidates"]}) == 8, "the rest is still estimated"


def test_the_same_seed_gives_the_same_estimate(trained, pictures, tmp_path):
    words = [pictures[0], "-g", trained, "-o", tmp_path / "a.glb", "--candidates", 4, "--steps", 2, "--seed"]
    first, again, other = estimated(*words, 1), estimated(*words, 1), estimated(*words, 2)
    assert first == again
    assert first != other


def test_python_and_the_command_line_say_the_same(trained, pictures, tmp_path):
    words = [pictures[0], "-g", trained, "-o", tmp_path / "a.glb", "--candidates", 4, "--steps", 2]
    (typed,) = estimated(*words, "--colours", "material")
    with Inverter.load(str(trained)) as inverter:
        estimate = rank(inverter.estimate(pictures[0], candidates=4, steps=2), inverter)
        asset = inverter.build(estimate.params)
    assert [candidate.params for candidate in estimate.candidates] == [c["params"] for c in typed["candidates"]]
    assert estimate.params == asset.params == typed["candidates"][0]["params"]
    assert estimate.view.azimuth_deg == typed["candidates"][0]["view"]["azimuth_deg"]
    assert estimate.spread == typed["spread"]
    assert asset.export(tmp_path / "b.glb").read_bytes() == (tmp_path / "a.glb").read_bytes()


def test_an_estimate_is_edited_and_built_again(trained, pictures, tmp_path):
    box = tmp_path / "box.json"
    (found,) = estimated(pictures[0], "-g", trained, "-o", tmp_path / "a.glb", "--params-out", box, "--candidates", 1)
    words = ["--set", "height=0.9", "has_legs=1", "leg_height=0.4", "top=open", "--params-out", tmp_path / "b.json"]
    made = json.loads(succeed("edit", box, "-o", tmp_path / "b.glb", *words, "--json"))
    assert trimesh.load(tmp_path / "b.glb").extents[1] == pytest.approx(0.9 + 0.4, abs=1e-5)
    changed = {"height": 0.9, "has_legs": True, "leg_height": 0.4, "top": "open"}
    expected = SPACE.canonical(found["candidates"][0]["params"] | changed)
    assert made["params"] == expected
    assert json.loads((tmp_path / "b.json").read_text())["params"] == expected


# Checkpoints that cannot be used


@pytest.fixture
def copied(trained, tmp_path) -> Path:
    return Path(shutil.copytree(trained, tmp_path / "copied"))


def refused(folder: Path, picture: Path) -> str:
    code, out, err = dipcg("estimate", picture, "-g", folder, "-o", folder.parent / "a.glb")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert not (folder.parent / "a.glb").exists()
    return err


@pytest.mark.parametrize("share", [0, 0.5, 0.999])
def test_weights_cut_short_are_refused(copied, pictures, share):
    weights = (copied / "model.safetensors").read_bytes()
    (copied / "model.safetensors").write_bytes(weights[: int(share * len(weights))])
    assert f"The weights in {copied / 'model.safetensors'} are damaged or cut short" in refused(copied, pictures[0])


def test_missing_weights_and_a_broken_card_are_refused(copied, pictures):
    (copied / "model.safetensors").unlink()
    assert "model.safetensors" in refused(copied, pictures[0])
    for text in ("", "{", "{}", '{"generator": "box"}'):
        (copied / "card.json").write_text(text)
        assert f"{copied} is not a checkpoint: its card.json cannot be read" in refused(copied, pictures[0])


def test_a_checkpoint_for_other_parameters_names_the_difference(copied, pictures):
    card = json.loads((copied / "card.json").read_text())
    card["fingerprint"] = "0123456789abcdef"
    card["space"][0]["high"] = 2.0
    card["space"][3]["options"].append("dome")
    (copied / "card.json").write_text(json.dumps(card))
    said = refused(copied, pictures[0])
    assert "was trained for other parameters of 'box': top, width differ. Train it again with `dipcg train`." in said


# Measuring


def test_evaluating_compares_the_estimate_with_its_bounds(trained, data, tmp_path):
    words = ["--count", 3, "--candidates", 2, "--steps", 2, "--metric", "chamfer", "parameter_error"]
    table = succeed("evaluate", trained, "--data", data, *words, "--json", tmp_path / "table.json")
    found = json.loads((tmp_path / "table.json").read_text())
    blind = ["prior (a random one)", "mean of the prior", "nearest of 54 random"]
    rows = ["noise floor", *blind, "direct guess", "most central sample", "estimate"]
    assert list(found) == rows
    lines = [line.split("|")[1].strip() for line in table.splitlines() if line]
    assert lines[2 : 2 + len(rows)] == rows
    # The differences from the estimate.
    assert lines[-len(rows) + 1 :] == rows[:-1]
    assert all(values["failures"] == 0 for values in found.values())
    (distance,) = found["noise floor"].keys() - {"failures", "against estimate"}
    for row in rows[1:]:
        mean, low, high = found[row][distance]
        assert found["noise floor"][distance][0] < low <= mean <= high, row
