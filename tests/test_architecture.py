"""The shape of the package: imports run one way, nothing heavy is loaded early, the README's file tree is true."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "dipcg"
README = ROOT / "README.md"

# A file may import its own layer and those above it in this list.
LAYERS = [
    ["space", "mesh", "surface", "camera", "images", "registry", "config", "recipes", "spread"],
    ["generators", "adopt", "codec", "worker", "blender", "draws", "shards", "store", "cluster", "render", "augment"]
    + ["captions", "locks", "compare", "mcmc", "trace"],
    ["encoders", "denoiser", "ddpm", "dit", "estimators", "diffusion", "sampling", "dataset", "telling", "validate"]
    + ["train", "tracking", "weights", "checkpoint", "rank", "refine", "recognise", "pipeline", "metrics", "evaluate"]
    + ["export", "export_gltf", "export_usd", "export_blend", "bake", "batch", "preview"]
    + ["team", "correct", "kinds", "heard", "snapshots", "tables", "baselines", "nearest", "topology", "foreign"]
    + ["published", "answer"],
    ["cli", "cli_assets", "cli_estimate", "cli_generators", "cli_learning", "cli_mcmc", "cli_meshes", "cli_import"]
    + ["cli_app", "app", "app_actions", "app_api", "app_cutout", "app_desk", "app_events", "app_limits", "app_page"]
    + ["app_parameters", "app_studio", "app_viewer", "app_work", "doctor", "listing", "terminal"]
    + ["__main__", "__init__"],
]
TORCH_FREE = {*LAYERS[0], *LAYERS[1], *LAYERS[3]}
FORBIDDEN_NAMES = {"utils", "core", "common", "helpers", "base"}
BLENDER = {"bpy", "infinigen"}
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
MAX_LINES = 300

FILES = sorted(PACKAGE.rglob("*.py"))
per_file = pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))


@per_file
def test_imports_run_one_way(path: Path) -> None:
    here = layer(module_name(path))
    for imported in imports(path):
        if imported.startswith("dipcg."):
            assert layer(imported) <= here, (
                f"{path.name} imports {imported}, which is built upon it; see ARCHITECTURE.md"
            )


def test_imports_have_no_cycle() -> None:
    graph = {module_name(path): {m for m in imports(path) if m.startswith("dipcg.")} for path in FILES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"These import each other: {' → '.join(error.args[1])}.")


@per_file
def test_blender_is_imported_by_workers_only(path: Path) -> None:
    early = {name.split(".")[0] for name in imports(path, module_level=True)}
    anywhere = {name.split(".")[0] for name in imports(path)}
    assert not early & BLENDER, (
        f"{path.name} starts Blender when it is imported; import inside the function that builds"
    )
    assert path.parent.name == "generators" or not anywhere & BLENDER, (
        f"{path.name} is no generator and imports Blender"
    )


@per_file
def test_lower_layers_are_free_of_torch(path: Path) -> None:
    name = top(module_name(path))
    lower = name in LAYERS[0] + LAYERS[1]
    named = imports(path, module_level=not lower)
    assert name not in TORCH_FREE or not any(top_level(m) == "torch" for m in named), f"{path.name} imports torch"


@pytest.mark.parametrize("what", ["import dipcg", "import dipcg.cli.doctor", "worker", "dipcg --help"])
def test_light_entry_points_load_neither_torch_nor_blender(what: str) -> None:
    code = {
        "worker": "import dipcg.workers.pool, dipcg.generators\n" + every_module_of(LAYERS[0] + LAYERS[1]),
        "dipcg --help": HELP,
    }.get(what, what)
    heavy = "print('loaded', sorted({'torch', 'bpy', 'infinigen', 'transformers', 'gradio'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", f"import sys\n{code}\n{heavy}"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().endswith("loaded []"), f"`{what}` {done.stdout.strip().splitlines()[-1]}"


def test_readme_tree_is_true() -> None:
    listed = readme_tree(README.read_text())
    there = {str(path.relative_to(PACKAGE)) for path in FILES if path.name != "__init__.py"}
    files = {name for name in listed if name.endswith(".py")}
    assert not there - files, f"These files have no line in the README's tree: {sorted(there - files)}."
    gone = sorted(name for name in listed if not (PACKAGE / name).exists())
    assert not gone, f"The README's tree names what is not there: {gone}."
    silent = sorted(name for name, words in listed.items() if name.endswith(".py") and not words)
    assert not silent, f"These lines of the README's tree do not say what the file is for: {silent}."


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


HELP = """
from dipcg.cli.commands import main
sys.argv = ["dipcg", "--help"]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
"""


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 2 else parts)


def top(module: str) -> str:
    """`generators` of `dipcg.generators.box`."""
    return module.split(".")[1]


def top_level(module: str) -> str:
    return module.split(".")[0]


def layer(module: str) -> int:
    for number, names in enumerate(LAYERS):
        if top(module) in names:
            return number
    raise AssertionError(f"{module} has no layer yet: give it one in LAYERS here and in ARCHITECTURE.md.")


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
    while name.count(".") > 1 and name.startswith("dipcg.") and not is_module(name):
        name = name.rpartition(".")[0]
    return "dipcg.__init__" if name == "dipcg" or (name.startswith("dipcg.") and not is_module(name)) else name


def is_module(name: str) -> bool:
    path = PACKAGE.parent.joinpath(*name.split("."))
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def every_module_of(names: list[str]) -> str:
    """Imports of all files of these modules and packages, as source."""
    chosen = [module_name(path) for path in FILES if top(module_name(path)) in names]
    return "\n".join(f"import {module}" for module in chosen)


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
