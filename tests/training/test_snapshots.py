"""Pictures in the log of training: they show photo and estimate, and nothing that fails or hangs stops or delays it."""

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
from dipcg.training import snapshots
from dipcg.training.log import Log
from dipcg.training.snapshots import SHOWN, SIDE, TAG
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
    build_dataset(str(folder / "ball.py"), folder / "data", 100)
    generator = load_generator(str(folder / "ball.py"))
    torch.manual_seed(0)
    save_checkpoint(folder / "run", Estimator(generator.space, TINY), generator, {})
    return folder


@pytest.fixture
def run(ball, tmp_path) -> Path:
    return Path(shutil.copytree(ball / "run", tmp_path / "run"))


@pytest.fixture
def spoilt(ball):
    """The same, with a function that replaces what a build does."""
    yield lambda body: (ball / "ball.py").write_text(BALL.replace("    return", f"    {body}\n    return"))
    (ball / "ball.py").write_text(BALL)


def logged(folder: Path, kind: str) -> list:
    events = accumulator.EventAccumulator(str(folder)).Reload()
    tags = events.Tags()
    if kind == "images":
        return [np.asarray(Image.open(io.BytesIO(e.encoded_image_string))) for e in find(events.Images, tags[kind])]
    return [event.tensor_proto.string_val[0].decode() for event in find(events.Tensors, tags["tensors"])]


def find(read, tags: list[str]) -> list:
    return [event for tag in tags if tag.startswith(TAG) for event in read(tag)]


def test_the_log_shows_photos_beside_estimates_once_for_the_same_weights(ball, run):
    with Log(run, ball / "data") as log:
        log(STATUS)
        log._snapshots._running.result()
        log(STATUS)
        log._snapshots._running.result()
    (sheet,) = logged(run, "images")
    assert sheet.shape == (SHOWN * SIDE, 2 * SIDE, 3)
    tiles = sheet.reshape(SHOWN, SIDE, 2, SIDE, 3).swapaxes(1, 2).reshape(2 * SHOWN, SIDE, SIDE, 3)
    for tile in tiles:  # a ball in the middle, on white: pi / 4 of the square that it fills
        covered = (tile < 250).any(2)
        rows, columns = covered.any(1).sum(), covered.any(0).sum()
        assert covered.sum() / (rows * columns) == pytest.approx(np.pi / 4, abs=0.06)
    assert not np.array_equal(tiles[0], tiles[1])


def test_the_work_yields_to_training_and_leaves_its_priority(ball, run):
    before = os.getpriority(os.PRIO_PROCESS, 0)
    with Log(run, ball / "data") as log:
        log(STATUS)
        log._snapshots._running.result()
        (child,) = log._snapshots._pool._children
        assert os.getpriority(os.PRIO_PROCESS, child._process.pid) == min(19, before + snapshots.LOW)
    assert os.getpriority(os.PRIO_PROCESS, 0) == before


def test_an_estimate_that_cannot_be_built_is_a_grey_tile(ball, run, spoilt):
    spoilt("raise ValueError('no')")
    with Log(run, ball / "data") as log:
        log(STATUS)
        log._snapshots._running.result()
    (sheet,) = logged(run, "images")
    assert (sheet[:, SIDE:] == 128).all()
    assert not (sheet[:, :SIDE] == 128).all()


def test_a_missing_checkpoint_is_told_and_the_rest_is_logged(ball, tmp_path):
    with Log(tmp_path, ball / "data") as log:
        log(STATUS)
    (text,) = logged(tmp_path, "tensors")
    assert text.startswith("There is no picture, FileNotFoundError")
    assert json.loads((tmp_path / "log.jsonl").read_text())["pictures"] == STATUS.pictures


def test_builds_that_hang_delay_neither_training_nor_its_end(ball, run, spoilt, monkeypatch):
    spoilt("time.sleep(600)")
    monkeypatch.setattr(snapshots, "LAST_S", 3.0)
    with Log(run, ball / "data") as log:
        log(STATUS)  # imports TensorBoard and starts the thread
        started = time.monotonic()
        for _ in range(5):
            log(STATUS)
        assert time.monotonic() - started < 2
        closing = time.monotonic()
    assert time.monotonic() - closing < 20
