"""No command writes over what it reads, by its name, a link, or another case of its letters."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from boxes import TRUTH
from serving import box_checkpoint

from dipcg.cli import main
from dipcg.cli.outputs import check_outputs
from dipcg.data.store import build_dataset
from dipcg.images import save_image
from dipcg.parameter_file import params_to_json

pytestmark = pytest.mark.slow

LAMP = Path(__file__).parents[2] / "examples"


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A working folder with one of each kind of file that commands read, and links to them."""
    monkeypatch.chdir(tmp_path)
    for name in ("lamp.toml", "lamp.blend"):
        shutil.copy(LAMP / name, name)
    Path("asset.json").write_text(params_to_json(TRUTH, "box"))
    Path("lamp.json").write_text(params_to_json({}, "lamp.toml"))
    save_image(np.full((64, 64, 3), 200, np.uint8), "photo.png")
    box_checkpoint(tmp_path / "runs" / "box")
    build_dataset("box", "data", 40)
    os.symlink("lamp.blend", "link.blend")
    os.link("asset.json", "hard.json")
    return tmp_path


COMMANDS = [
    "sample lamp.toml -o lamp.blend",
    "sample lamp.toml -o ./lamp.blend",
    "sample lamp.toml -o link.blend",
    "sample lamp.toml -o LAMP.blend",
    "edit lamp.json -o lamp.blend",
    "edit asset.json -o a.glb --params-out asset.json",
    "edit asset.json -o a.glb --params-out hard.json",
    "edit asset.json -o a.glb --params-out Asset.json",
    "estimate photo.png -g runs/box -o a.glb --preview photo.png",
    "estimate photo.png -g runs/box -o a.glb --params-out runs/box/card.json",
    "estimate --text words -g runs/box -o a.glb --params-out runs/box/card.json",
    "evaluate runs/box --data data --json runs/box/card.json",
    "evaluate runs/box --data data --json data/dataset.json",
    "mcmc runs/box/best.png -g box -o runs/box",
    "train box --data data --start runs/box -o runs",
]


@pytest.mark.parametrize("line", COMMANDS)
def test_what_is_read_is_not_written_over(folder, capsys, line):
    shutil.copy("photo.png", "runs/box/best.png")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(SystemExit) as end:
        main(line.split())
    assert end.value.code == 1
    assert "would be overwritten; choose another name or folder." in capsys.readouterr().err
    now = {path: path.read_bytes() for path in before}
    assert now == before


def test_files_that_differ_are_let_through(tmp_path):
    (tmp_path / "a.png").touch()
    check_outputs((tmp_path / "a.glb", None, tmp_path / "b.png"), (tmp_path / "a.png", None, "chair"))


@pytest.mark.parametrize("outputs", [("a.glb", "a.glb"), ("a.glb", "./A.glb"), ("a.obj", "a.mtl")])
def test_one_file_is_not_written_twice(tmp_path, monkeypatch, outputs):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="would be overwritten"):
        check_outputs(map(Path, outputs), ())
