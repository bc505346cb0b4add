"""Files are written whole or not at all: a full disk, an error or a kill leaves what was there before."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from disk import full_disk

from dipcg.cli.batch import open_batch
from dipcg.config import ModelConfig
from dipcg.export.asset import FORMATS
from dipcg.files import locked, write_file, written
from dipcg.generators import load_generator
from dipcg.images import save_image
from dipcg.inference.classifier import Classifier
from dipcg.inference.trace import Line, plot_traces
from dipcg.model.checkpoint import write_checkpoint
from dipcg.training.state import save_state

OLD = b"what was there before"
NOISE = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# Every writer: it gets the path of a file that is there already.
def checkpoint(path: Path, asset) -> None:
    weights = {"weight": torch.zeros(100)}
    write_checkpoint(path.parent, weights, ModelConfig(), load_generator("box"), {"note": "x" * 1000})


def state(path: Path, asset) -> None:
    save_state(path.parent, {"model": torch.nn.Linear(30, 30)}, {}, {"step": 1}, {})


def page(path: Path, asset) -> None:
    pictures = path.parent.parent / "pictures"
    pictures.mkdir(exist_ok=True)
    (pictures / "a.png").write_bytes(b"")
    open_batch(pictures, path.parent).write_page({})


WRITERS = {
    **{f"asset{suffix}": lambda path, asset: asset.export(path) for suffix in FORMATS},
    "params.json": lambda path, asset: asset.save_params(path),
    "picture.png": lambda path, asset: save_image(NOISE, path),
    "figure.png": lambda path, asset: plot_traces({"a": [Line(1.0, 0.5, 0.5)]}, path),
    "model.safetensors": checkpoint,
    "state.safetensors": state,
    "classifier.safetensors": lambda path, asset: Classifier(("a",), "b", torch.zeros(1, 99), torch.zeros(1)).save(
        path
    ),
    "index.html": page,
}
BLENDER = pytest.param("asset.blend", marks=pytest.mark.blender)


@pytest.mark.slow
@pytest.mark.parametrize("name", [BLENDER if name == "asset.blend" else name for name in WRITERS])
def test_a_full_disk_leaves_the_file_that_was_there(name, tmp_path, asset):
    path = tmp_path / "out" / name
    path.parent.mkdir()
    path.write_bytes(OLD)
    with full_disk(), pytest.raises((OSError, ValueError, RuntimeError)):
        WRITERS[name](path, asset)
    assert content(path.parent) == {name: OLD}
    WRITERS[name](path, asset)
    assert len(path.read_bytes()) > 100, "with room on the disk it is written"


def test_all_files_of_an_asset_are_replaced_or_none(tmp_path, textured):
    textured.export(tmp_path / "asset.usda")
    before = content(tmp_path)
    assert len(before) > 1, "the maps lie beside it"
    with full_disk(1000), pytest.raises((OSError, ValueError)):
        textured.export(tmp_path / "asset.usda")
    assert content(tmp_path) == before


def write_half_a_file(path: Path) -> None:
    with written(path) as unfinished:
        unfinished.write_text("half")
        raise KeyError


def test_an_error_leaves_the_file_that_was_there(tmp_path):
    write_file(tmp_path / "a.txt", "old")
    with pytest.raises(KeyError):
        write_half_a_file(tmp_path / "a.txt")
    assert content(tmp_path) == {"a.txt": b"old"}


KILLED = """
import os, signal, sys
from dipcg.files import written
with written(sys.argv[1]) as unfinished:
    unfinished.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_kill_leaves_the_file_that_was_there(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    killed = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "a.txt")], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert (tmp_path / "a.txt").read_text() == "old"


def test_a_link_stays_a_link_and_others_may_read_the_file(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link.txt").symlink_to(tmp_path / "elsewhere" / "real.txt")
    write_file(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "elsewhere" / "real.txt").read_text() == "new"
    umask = os.umask(0o022)
    os.umask(umask)
    assert (tmp_path / "elsewhere" / "real.txt").stat().st_mode & 0o777 == 0o666 & ~umask


def test_the_error_names_the_file_and_not_the_place_beside_it(tmp_path):
    with pytest.raises(OSError) as caught:
        write_file(tmp_path / "missing" / "a.txt", "text")
    assert caught.value.filename == str(tmp_path / "missing" / "a.txt")


# Locks

HOLDS = """
import sys, time
from pathlib import Path
from dipcg.files import locked
with locked(Path(sys.argv[1]), "works"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_folder_is_held_by_one_process_and_a_kill_frees_it(tmp_path):
    holder = subprocess.Popen([sys.executable, "-c", HOLDS, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(ValueError, match=f"Another process works in {tmp_path}"), locked(tmp_path, "works"):
            pass
    finally:
        holder.kill()
        holder.wait()
        holder.stdout.close()
    with locked(tmp_path, "works"):
        pass
