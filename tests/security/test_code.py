"""A data file runs no code: a Python file runs only if its path stands on the command line."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from boxes import TRUTH
from serving import box_checkpoint

from dipcg.cli import main
from dipcg.data.store import build_dataset
from dipcg.generators import load_generator
from dipcg.images import save_image
from dipcg.inference.inverters import Inverters
from dipcg.metrics import load_metric
from dipcg.model.checkpoint import load_checkpoint
from dipcg.model.zoo import CARD, SHIPPED, find_checkpoint
from dipcg.parameter_file import params_to_json
from dipcg.registry import CodeError

pytestmark = pytest.mark.slow

# It leaves a mark where it runs, and is otherwise the box.
EVIL = """
from pathlib import Path
Path({mark!r}).touch()
from dipcg.generators.box import *
from dipcg.generators.box import space, build
"""


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A working folder with a Python file and data that names it: an asset, a data set and two checkpoints."""
    monkeypatch.chdir(tmp_path)
    Path("evil.py").write_text(EVIL.format(mark=str(tmp_path / "ran")))
    Path("asset.json").write_text(params_to_json(TRUTH, "evil.py"))
    build_dataset("box", "data", 40)
    rewrite("data/dataset.json", ref="evil.py")
    shutil.copytree(box_checkpoint(tmp_path / "made"), "run")
    rewrite("run/card.json", ref="evil.py")
    shutil.copytree("run", "encoder")
    card = json.loads(Path("encoder/card.json").read_text())
    rewrite("encoder/card.json", ref="box", model=card["model"] | {"encoder": "evil.py"})
    save_image(np.full((64, 64, 3), 200, np.uint8), "photo.png")
    return tmp_path


def rewrite(file: str, **changes: object) -> None:
    Path(file).write_text(json.dumps(json.loads(Path(file).read_text()) | changes))


def run(line: str) -> int:
    try:
        main(line.split())
    except SystemExit as end:
        return int(end.code or 0)
    return 0


COMMANDS = [
    "edit asset.json -o a.glb",
    "dataset info data",
    "dataset gallery data -o a.png",
    "train box --data data",
    "train box --data data --start run",
    "evaluate run --data data",
    "evaluate box --pairs . --meshes data",
    "estimate photo.png -g run -o a.glb",
    "estimate photo.png -g encoder -o a.glb",
    "estimate photo.png -g ./run -o a.glb",
    "mcmc photo.png -g box --score conv -o search",
    "serve run",
]
UNCONCERNED = ("evaluate box --pairs . --meshes data", "mcmc photo.png -g box --score conv -o search")


@pytest.mark.parametrize("line", COMMANDS)
def test_a_data_file_that_names_a_python_file_does_not_run_it(folder, capsys, line):
    assert run(line) == 1
    assert not (folder / "ran").exists()
    if line not in UNCONCERNED:
        assert "The Python file evil.py" in (said := capsys.readouterr().err)
        assert "--allow-code evil.py" in said


@pytest.mark.parametrize("flag", ["--allow-code evil.py", "--allow-code=./evil.py", "--allow-code {folder}/evil.py"])
def test_the_flag_allows_the_file(folder, flag):
    assert run(f"dataset info data {flag.format(folder=folder)}") == 0
    assert (folder / "ran").exists()


def test_a_file_on_the_command_line_needs_no_flag(folder):
    assert run("generators evil.py") == 0
    assert (folder / "ran").exists()


def test_the_flag_needs_a_file(folder, capsys):
    assert run("dataset info data --allow-code") == 2
    assert not (folder / "ran").exists()


def test_another_file_than_the_allowed_one_does_not_run(folder):
    Path("mine.py").write_text("from dipcg.generators.box import space, build")
    assert run("edit asset.json -o a.glb --allow-code mine.py") == 1
    assert not (folder / "ran").exists()


@pytest.mark.parametrize("load", [load_generator, load_metric], ids=["generator", "metric"])
def test_a_program_names_the_files_that_may_run(folder, load):
    with pytest.raises(CodeError, match=r"dipcg\.allow_code"):
        load("evil.py")
    assert not (folder / "ran").exists()


def test_a_checkpoint_that_names_a_file_is_refused_from_python_too(folder):
    for checkpoint in ("run", "encoder"):
        with pytest.raises(CodeError):
            load_checkpoint(checkpoint)
    assert not (folder / "ran").exists()


def test_what_ships_comes_before_a_folder_of_the_same_name(folder):
    for name in ("chair", "box"):
        shutil.copytree("run", name)
    assert find_checkpoint("chair") == SHIPPED / "chair"
    assert find_checkpoint("./chair") == Path("chair")
    with pytest.raises(ValueError, match="There is no trained checkpoint for 'box'"):
        find_checkpoint("box")
    assert list(Inverters(["chair"])) == ["chair"]
    assert json.loads((find_checkpoint("chair") / CARD).read_text())["ref"] == "chair"


def test_two_checkpoints_of_one_generator_are_refused(folder):
    for name in ("a", "b"):
        shutil.copytree(folder / "made", f"{name}/box")
    with pytest.raises(ValueError, match=r"a/box and b/box are both for the generator 'box'; give only one of them"):
        Inverters(["a/box", "b/box"])
    assert list(Inverters(["a/box", "./a/box"])) == ["box"]
