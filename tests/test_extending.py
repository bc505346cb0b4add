"""docs/extending.md is true: its files are written, its commands run, in order, with small counts and a tiny model."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dipcg.cli import main
from dipcg.data.store import Store
from dipcg.generators import load_generator
from dipcg.images import MARGIN, save_image
from dipcg.parameter_file import params_from_json
from dipcg.registry import allow_code
from dipcg.render import Renderer

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "extending.md").read_text()
SMALLER = {"--count 5000": "--count 40", "--count 50": "--count 1 --candidates 2 --steps 2 --metric chamfer"}
SMALLER["--minutes 30"] = "--minutes 0.05 --denoiser-share 0.5 --depth 1 --batch 16"
TRAIN = """
import sys
from dipcg.cli import main
from dipcg.training import train
train.VALIDATION_PICTURES = 4
main(sys.argv[1:])
"""
TINY_ESTIMATE = " --candidates 2 --steps 2"


def recipe(title: str) -> str:
    return re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)[1]


def blocks(title: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", recipe(title), re.MULTILINE | re.DOTALL)


def commands(title: str) -> list[str]:
    lines = [line for block in blocks(title, "sh") for line in block.splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def write_file(title: str) -> Path:
    """The file of a recipe, under the name that the line before its block gives."""
    (name,) = re.findall(r"`(\w+\.py)`:\n\n```python", recipe(title))
    (text,) = blocks(title, "python")
    Path(name).write_text(text)
    return Path(name)


def run(line: str) -> None:
    """One command of the page, made small; training in a process of its own, since it forks."""
    for large, small in SMALLER.items():
        line = line.replace(large, small)
    program, *words = shlex.split(line + (TINY_ESTIMATE if " estimate " in line else ""))
    assert program == "dipcg"
    if words[0] == "train":
        done = subprocess.run([sys.executable, "-c", TRAIN, *words], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    else:
        main(words)
    if words[:2] == ["dataset", "build"]:
        take_photo(words[words.index("-o") + 1])


def take_photo(data: str) -> None:
    """photo.png: an unseen shape of a data set, rendered."""
    store, renderer = Store(data), Renderer(128)
    shown = next(store.samples("test"))
    view = load_generator(store.info["ref"]).views.sample(np.random.default_rng(0))
    save_image(np.ascontiguousarray(renderer.render(shown.mesh, view, margin=MARGIN)), "photo.png")
    renderer.close()


def size(path: str) -> np.ndarray:
    return trimesh.load(path).extents


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_the_page_has_five_recipes_and_every_block_is_one_that_is_run():
    # Programs with a seed and OpenSCAD files are run by tests/importing.
    titles = [
        "A Blender file",
        "A program with a seed",
        "An OpenSCAD file",
        "A Python function",
        "A function of another library",
    ]
    assert re.findall(r"^## (.*)$", PAGE, re.MULTILINE)[:5] == titles
    known = sum(len(blocks(title, language)) for title in titles for language in ("sh", "python", "toml"))
    assert PAGE.count("```") == 2 * known


@pytest.mark.blender
@pytest.mark.skipif(find_spec("bpy") is None, reason="bpy not installed")
def test_a_blender_file(capsys):
    shutil.copy(ROOT / "examples" / "lamp.blend", ".")
    for line in commands("A Blender file"):
        run(line)
        if "generators add" in line:
            edit_by_hand(Path("lamp.toml"))
    assert size("taller.glb")[1] > size("lamp.glb")[1]
    assert params_from_json(Path("lamp.json").read_text())[1]["shade"] == "Dome"
    found, changed = (json.loads(Path(name).read_text()) for name in ("found.json", "lamp.json"))
    assert found["generator"] == changed["generator"] == "lamp.toml"
    assert load_generator("lamp.toml").space.validate(found["params"]) == found["params"]
    assert Path("square.glb").exists()
    assert "| estimate" in capsys.readouterr().out


def edit_by_hand(path: Path) -> None:
    """The line that the page adds; afterwards the file is the one in examples/."""
    (mirrors,) = blocks("A Blender file", "toml")
    path.write_text(path.read_text().replace("\n\n[parameters", f"\n{mirrors}\n\n[parameters", 1))
    ours, shipped = load_generator("lamp.toml"), load_generator(str(ROOT / "examples" / "lamp.toml"))
    assert ours.mirrors == shipped.mirrors
    assert {p.name: p.when for p in ours.space} == {p.name: p.when for p in shipped.space}
    assert ours.space.names == shipped.space.names


def test_a_python_function():
    path = write_file("A Python function")
    for line in commands("A Python function"):
        run(line)
    assert load_generator(str(path)).mirrors is None
    assert size("stool.glb")[1] < 0.9
    assert Path("found.glb").exists()


def test_a_python_function_of_an_installed_package(monkeypatch):
    """A distribution as pip would lay it out, made from the page's entry point."""
    (block,) = blocks("A Python function", "toml")
    (entry,) = tomllib.loads(block)["project"]["entry-points"]["dipcg.generators"].items()
    name, module = entry
    package = Path("site") / module.split(".")[0]
    package.mkdir(parents=True)
    shutil.move(write_file("A Python function"), package / f"{module.split('.')[1]}.py")
    (package / "__init__.py").touch()
    info = Path("site") / "my_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[dipcg.generators]\n{name} = {module}\n")
    monkeypatch.syspath_prepend("site")
    monkeypatch.setenv("PYTHONPATH", str(Path("site").resolve()))
    run(f"dipcg sample {name} -o stool.glb --params-out stool.json")
    assert params_from_json(Path("stool.json").read_text())[0] == name
    run("dipcg edit stool.json -o stool.glb --set legs=4")


STAND_IN = """
import bpy

class Made:
    def __init__(self, obj): self.mesh, self.item = self, lambda: obj

def vase(height=0.3, neck_scale=0.5, profile_star_points=24):
    bpy.ops.mesh.primitive_cylinder_add(vertices=profile_star_points, radius=0.1, depth=height)
    return Made(bpy.context.object)
"""


@pytest.mark.blender
@pytest.mark.skipif(find_spec("bpy") is None, reason="bpy not installed")
def test_a_function_of_another_library(monkeypatch):
    folder = Path("site") / "infinigen2" / "objects"
    folder.mkdir(parents=True)
    (folder / "vase.py").write_text(STAND_IN)
    monkeypatch.syspath_prepend("site")
    monkeypatch.setenv("PYTHONPATH", str(Path("site").resolve()))
    path = write_file("A function of another library")
    for line in commands("A function of another library"):
        run(f"{line} --params-out vase.json")
    params = params_from_json(Path("vase.json").read_text())[1]
    assert size("vase.glb")[1] == pytest.approx(params["height"], abs=1e-4)
    assert load_generator(str(path)).needs == ("infinigen2", "bpy")


def test_the_seashell_is_watertight_with_its_faces_outwards():
    allow_code(ROOT / "examples" / "seashell.py")
    shell, rng = load_generator(str(ROOT / "examples" / "seashell.py")), np.random.default_rng(0)
    for hand in ("right", "left") * 4:
        mesh = shell.build(shell.space.replace(shell.space.sample(rng), {"hand": hand}))
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert solid.is_watertight
        assert solid.is_winding_consistent
        assert solid.volume > 0
