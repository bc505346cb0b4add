"""Pictures in the log of training: they show photos and estimates, and no error or hang stops or delays training."""

import io
import json
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from boxes import TINY
from PIL import Image

from dipcg.data.store import build_dataset
from dipcg.generators import load_generator
from dipcg.model.checkpoint import save_checkpoint
from dipcg.model.estimators import Estimator
from dipcg.registry import allow_code
from dipcg.training import snapshots
from dipcg.training.log import Log
from dipcg.training.snapshots import SHAPES, SIDE, TAG
from dipcg.training.train import Status
from dipcg.training.validate import Validation

accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")

BALL = """
import time

import trimesh

from dipcg.space import ParameterSpace, Real

space = ParameterSpace(Real("radius", 0.9, 1.1, unit="m", doc="of the ball"))


def build(params):
    return trimesh.creation.icosphere(2, params["radius"])
"""
STATUS = Status(0.5, 640, 0.3, 50.0, 0.1, Validation(0.4, 0.5, 0.5, 0.4, 1.0))


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> Path:
    """A generator, a data set of it in `data` and an untrained checkpoint in `run`."""
    folder = tmp_path_factory.mktemp("ball")
    (folder / "ball.py").write_text(BALL)
    allow_code(folder / "ball.py")
    build_dataset(str(folder / "ball.py"), folder / "data", 100)
    generator = load_generator(str(folder / "ball.py"))
    torch.manual_seed(0)
    save_checkpoint(folder / "run", Estimator(generator.space, TINY), generator, {})
    return folder


@pytest.fixture
def run(ball, tmp_path) -> Path:
    return Path(shutil.copytree(ball / "run", tmp_path / "run"))


@pytest.fixture
def change_build(ball):
    """A function that inserts a statement into the generator's `build`, until the test ends."""
    yield lambda body: (ball / "ball.py").write_text(BALL.replace("    return", f"    {body}\n    return"))
    (ball / "ball.py").write_text(BALL)


def logged(folder: Path, kind: str) -> list:
    """The pictures or the texts of `Snapshots` in the event files of a folder."""
    events = accumulator.EventAccumulator(str(folder)).Reload()
    tags = events.Tags()
    if kind == "images":
        images = snapshot_events(events.Images, tags[kind])
        return [np.asarray(Image.open(io.BytesIO(event.encoded_image_string))) for event in images]
    texts = snapshot_events(events.Tensors, tags["tensors"])
    return [event.tensor_proto.string_val[0].decode() for event in texts]


def snapshot_events(read, tags: list[str]) -> list:
    return [event for tag in tags if tag.startswith(TAG) for event in read(tag)]


def test_the_log_has_photos_beside_estimates_once_for_the_same_weights(ball, run):
    with Log(run, ball / "data") as log:
        log(STATUS)
        log._snapshots._running.result()
        log(STATUS)
        log._snapshots._running.result()
    (sheet,) = logged(run, "images")
    assert sheet.shape == (SHAPES * SIDE, 2 * SIDE, 3)
    tiles = sheet.reshape(SHAPES, SIDE, 2, SIDE, 3).swapaxes(1, 2).reshape(2 * SHAPES, SIDE, SIDE, 3)
    # A ball covers pi / 4 of the square around it, and the ground is white.
    for tile in tiles:
        covered = (tile < 250).any(2)
        rows, columns = covered.any(1).sum(), covered.any(0).sum()
        assert covered.sum() / (rows * columns) == pytest.approx(np.pi / 4, abs=0.06)
    assert not np.array_equal(tiles[0], tiles[1])


def test_snapshots_have_a_lower_priority_and_training_keeps_its_own(ball, run):
    before = os.getpriority(os.PRIO_PROCESS, 0)
    with Log(run, ball / "data") as log:
        log(STATUS)
        log._snapshots._running.result()
        (child,) = log._snapshots._pool._children
        assert os.getpriority(os.PRIO_PROCESS, child._process.pid) == min(19, before + snapshots.NICENESS)
    assert os.getpriority(os.PRIO_PROCESS, 0) == before


def test_an_estimate_that_cannot_be_built_is_a_grey_tile(ball, run, change_build):
    change_build("raise ValueError('no')")
    with Log(run, ball / "data") as log:
        log(STATUS)
        log._snapshots._running.result()
    (sheet,) = logged(run, "images")
    assert (sheet[:, SIDE:] == 128).all()
    assert not (sheet[:, :SIDE] == 128).all()


def test_a_missing_checkpoint_is_logged_as_a_text_beside_the_curves(ball, tmp_path):
    with Log(tmp_path, ball / "data") as log:
        log(STATUS)
    (text,) = logged(tmp_path, "tensors")
    assert text.startswith("The pictures could not be made: FileNotFoundError")
    assert json.loads((tmp_path / "log.jsonl").read_text())["pictures"] == STATUS.pictures


def test_builds_that_hang_delay_neither_training_nor_its_end(ball, run, change_build, monkeypatch):
    change_build("time.sleep(600)")
    monkeypatch.setattr(snapshots, "CLOSE_LIMIT_S", 3.0)
    with Log(run, ball / "data") as log:
        # The first call imports TensorBoard and starts the thread.
        log(STATUS)
        started = time.monotonic()
        for _ in range(5):
            log(STATUS)
        assert time.monotonic() - started < 2
        closing = time.monotonic()
    assert time.monotonic() - closing < 20
