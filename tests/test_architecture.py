"""The shape of the package: imports run one way, nothing heavy is loaded early, the README's file tree is true."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tokenize
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "dipcg"
README = ROOT / "README.md"


@dataclass(frozen=True)
class Room:
    """A folder: the rooms right below it, and where its files may import torch and Blender."""

    below: str
    torch: str = "never"
    blender: str = "never"


# A file may import its own room and every room below it. "root" is the files right in the package.
ROOMS = {
    "cli": Room("app training evaluation importing", torch="in functions"),
    "app": Room("inference importing", torch="anywhere"),
    "training": Room("inference", torch="anywhere"),
    "evaluation": Room("inference", torch="anywhere"),
    "inference": Room("pipeline metrics render", torch="anywhere"),
    "pipeline": Room("data export model results", torch="anywhere"),
    "results": Room("images mesh"),
    "export": Room("workers"),
    "importing": Room("workers metrics"),
    "data": Room("workers"),
    "model": Room("encoders generators", torch="anywhere"),
    "workers": Room("generators"),
    "generators": Room("tracing openscad", blender="in functions"),
    "openscad": Room("blender"),
    "tracing": Room("blender"),
    "blender": Room("mesh", blender="in functions"),
    "encoders": Room("images", torch="anywhere"),
    "images": Room("root", torch="anywhere"),
    "metrics": Room("mesh", torch="anywhere"),
    "render": Room("mesh"),
    "mesh": Room("root"),
    "root": Room(""),
}
# The faces of the package, which import what they show when they are asked for it.
FACES = {"dipcg", "dipcg.__main__"}
FORBIDDEN_NAMES = {"utils", "core", "common", "helpers", "base"}
BLENDER = {"bpy", "infinigen"}
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
MAX_LINES = 300
FOR_TOOLS = re.compile(r"#\s*(noqa|fmt|type|pyright|ruff)\b")

FILES = sorted(PACKAGE.rglob("*.py"))
per_file = pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))


@per_file
def test_imports_run_one_way(path: Path) -> None:
    here = module_name(path)
    for imported in imports(path):
        assert here in FACES or may_import(here, imported), (
            f"{here} imports {imported}, but {room(here)} may import only {room(here)} and "
            f"{', '.join(sorted(below(room(here)))) or 'nothing else'} of this package; see ARCHITECTURE.md"
        )


def test_the_rule_refuses_what_runs_back_up() -> None:
    assert may_import("dipcg.app.server", "dipcg.inference.rank")
    assert may_import("dipcg.inference.rank", "dipcg.camera")
    assert not may_import("dipcg.data.store", "dipcg.pipeline")
    assert not may_import("dipcg.space", "dipcg.generators")
    assert not may_import("dipcg.mesh.copies", "dipcg.render.studio")
    assert not may_import("dipcg.camera", "dipcg.mesh")
    assert not may_import("dipcg.encoders.conv", "dipcg.metrics.chamfer")
    assert not may_import("dipcg.training.train", "dipcg.evaluation.evaluate")


def test_imports_have_no_cycle() -> None:
    graph = {module_name(path): {m for m in imports(path) if m.startswith("dipcg.")} for path in FILES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"These import each other: {' → '.join(error.args[1])}.")


@per_file
@pytest.mark.parametrize("packages", [{"torch"}, BLENDER], ids=["torch", "Blender"])
def test_heavy_packages_are_imported_where_the_room_allows(path: Path, packages: set[str]) -> None:
    allowed = ROOMS[room(module_name(path))]
    rule = allowed.torch if packages == {"torch"} else allowed.blender
    found = {top_level(name) for name in imports(path, module_level=rule == "in functions")} & packages
    assert rule == "anywhere" or not found, f"{path.name} imports {found}, which its room allows {rule}"


@pytest.mark.parametrize("what", ["import dipcg", "import dipcg.cli.doctor", "rooms", "dipcg --help"])
def test_light_entry_points_load_neither_torch_nor_blender(what: str) -> None:
    code = {"rooms": imports_without_torch(), "dipcg --help": HELP}.get(what, what)
    heavy = "print('loaded', sorted({'torch', 'bpy', 'infinigen', 'transformers', 'fastapi'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", f"import sys\n{code}\n{heavy}"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().endswith("loaded []"), f"`{what}` {done.stdout.strip().splitlines()[-1]}"


def test_readme_tree_is_true() -> None:
    listed = readme_tree(README.read_text())
    files = {path.name for path in PACKAGE.glob("*.py") if not path.name.startswith("__")}
    folders = {f"{name}/" for name in ROOMS if (PACKAGE / name).is_dir()}
    missing = (files | folders) - listed.keys()
    assert not missing, f"These have no line in the README's tree: {sorted(missing)}."
    gone = sorted(name for name in listed if not (PACKAGE / name).exists())
    assert not gone, f"The README's tree names what is not there: {gone}."
    silent = sorted(name for name, words in listed.items() if not words)
    assert not silent, f"These lines of the README's tree do not say what the file is for: {silent}."


def test_every_room_is_in_the_table() -> None:
    folders = {path.parent.name for path in PACKAGE.glob("*/*.py")}
    assert folders == {name for name in ROOMS if (PACKAGE / name).is_dir()}


def test_the_tree_reader_reads_both_common_drawings() -> None:
    plain = "```text\nsrc/dipcg/\n  a.py   first\n  sub/   a folder\n    b.py   second\n  c.py\ntests/\n  t.py x\n```"
    drawn = "```\nsrc/dipcg/\n├── a.py   first\n├── sub/   a folder\n│   └── b.py   second\n└── c.py\n```"
    expected = {"a.py": "first", "sub/": "a folder", "sub/b.py": "second", "c.py": ""}
    assert readme_tree(plain) == readme_tree(drawn) == expected


@per_file
def test_names_say_what_is_inside(path: Path) -> None:
    parts = {path.stem.strip("_"), *(folder.strip("_") for folder in path.relative_to(PACKAGE).parts[:-1])}
    assert not parts & FORBIDDEN_NAMES, f"{path.name}: name the file after what it holds"


@per_file
def test_files_are_short(path: Path) -> None:
    count = len(path.read_text().splitlines())
    assert count <= MAX_LINES, f"{path.name} has {count} lines, at most {MAX_LINES}; is there a second subject in it?"


def test_the_results_fit_on_one_page() -> None:
    """Whoever adds a line takes another to the page of its experiment."""
    assert len((ROOT / "docs/results.md").read_text().splitlines()) <= 150


@pytest.mark.parametrize("folder", ["src", "tests", "benchmarks", "examples", "addon"])
def test_comments_stand_on_lines_of_their_own(folder: str) -> None:
    trailing = [place for path in (ROOT / folder).rglob("*.py") for place in comments_behind_code(path)]
    assert not trailing, f"Put these comments above the code, as sentences: {', '.join(trailing)}."


def test_a_comment_behind_code_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("a = 1  # noqa: X\n# above\nb = '# no comment'\nc = 2  # behind\n")
    assert comments_behind_code(tmp_path / "a.py") == ["a.py:4"]


HELP = """
from dipcg.cli import main
sys.argv = ["dipcg", "--help"]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
"""


def comments_behind_code(path: Path) -> list[str]:
    """The places of comments that share a line with code, other than those that tools read."""
    with path.open("rb") as file:
        comments = [token for token in tokenize.tokenize(file.readline) if token.type == tokenize.COMMENT]
    behind = [token for token in comments if token.line[: token.start[1]].strip() and not FOR_TOOLS.match(token.string)]
    return [f"{path.name}:{token.start[0]}" for token in behind]


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room(module: str) -> str:
    """`generators` of `dipcg.generators.box`, `root` of `dipcg.space`."""
    first = module.split(".")[1] if "." in module else ""
    return first if first in ROOMS else "root"


def below(name: str) -> set[str]:
    """All rooms that files of a room may import besides their own."""
    direct = set(ROOMS[name].below.split()) | ({"root"} - {name})
    return direct.union(*(below(other) for other in direct - {"root"}))


def may_import(module: str, imported: str) -> bool:
    own = room(module)
    return top_level(imported) != "dipcg" or room(imported) in {own} | below(own)


def top_level(module: str) -> str:
    return module.split(".")[0]


def imports(path: Path, module_level: bool = False) -> set[str]:
    """The full names of the modules a file imports, wherever in it, or when it is itself imported."""
    tree = ast.parse(path.read_text())
    nodes = outside_functions(tree) if module_level else ast.walk(tree)
    return {name for node in nodes for name in imported_by(node, path)}


def outside_functions(node: ast.AST) -> list[ast.AST]:
    below = [child for child in ast.iter_child_nodes(node) if not isinstance(child, FUNCTIONS)]
    return [found for child in below for found in [child, *outside_functions(child)]]


def imported_by(node: ast.AST, path: Path) -> list[str]:
    if isinstance(node, ast.Import):
        return [resolve(alias.name) for alias in node.names]
    if not isinstance(node, ast.ImportFrom):
        return []
    package = ".".join(path.relative_to(PACKAGE.parent).parts[: -node.level]) if node.level else ""
    module = ".".join(part for part in (package, node.module) if part)
    return [resolve(f"{module}.{alias.name}") for alias in node.names]


def resolve(name: str) -> str:
    """The module that holds a dotted name: `dipcg.space` of `dipcg.space.Real`; other packages unchanged."""
    while name.count(".") > 0 and top_level(name) == "dipcg" and not is_module(name):
        name = name.rpartition(".")[0]
    return name


def is_module(name: str) -> bool:
    path = PACKAGE.parent.joinpath(*name.split("."))
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def imports_without_torch() -> str:
    """Imports of all files of the rooms that never import torch when they are imported, as source."""
    chosen = [module_name(path) for path in FILES if ROOMS[room(module_name(path))].torch != "anywhere"]
    return "\n".join(f"import {module}" for module in chosen if not module.endswith("__main__"))


def readme_tree(text: str) -> dict[str, str]:
    """From the block that starts with `src/dipcg/`: each name below it and the words beside it."""
    match = re.search(r"^src/dipcg/.*\n((?:[\s│├└─].*\n)*)", text, re.MULTILINE)
    assert match is not None, "README.md needs a block with the line `src/dipcg/` and a line for each file under it."
    listed: dict[str, str] = {}
    folders: list[tuple[int, str]] = []
    for line in match[1].splitlines():
        entry = re.match(r"^[\s│├└─]*(?P<name>[\w.]+/?)(?P<words>.*)$", line)
        if entry is None:
            continue
        folders = [folder for folder in folders if folder[0] < entry.start("name")]
        name = "".join(folder for _, folder in folders) + entry["name"]
        listed[name] = entry["words"].strip()
        if name.endswith("/"):
            folders.append((entry.start("name"), entry["name"]))
    return listed
