"""Finding a seeded program and calling it, in a child process."""

from __future__ import annotations

import ast
import functools
import importlib
import importlib.util
import inspect
import re
import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from dipcg.mesh import Mesh
from dipcg.tracing.draws import Choose, Draw, ProgramError, Recorder, install
from dipcg.tracing.returned import read

SEED_NAMES = ("seed", "factory_seed", "random_seed", "random_state", "rng", "generator", "random")
GENERATOR_NAMES = ("rng", "generator")
# Infinigen makes some surfaces of cells of this size, in metres; its own default of 3 mm takes minutes.
FACE_SIZE_M = 0.02
FACTORIES = "infinigen/assets/objects"


def run(program: str, seed: int, arguments: Mapping[str, Any], choose: Choose) -> tuple[Mesh, list[Draw]]:
    """Run a program once with chosen draws: the mesh that it made, and its draws.

    Raises ProgramError for what cannot be called or recorded, MeshError for no usable mesh, and what it raises itself.
    """
    call = load(program)
    _clean()
    with Recorder(seed, choose, _called.__code__) as recorder:
        made = _called(call, seed, arguments)
    return read(made), recorder.draws


def _called(call: Callable[..., Any], seed: int, arguments: Mapping[str, Any]) -> Any:
    """The one frame above all frames of a program: sites of draws are counted from here."""
    try:
        return call(seed, arguments)
    except EOFError:
        raise ProgramError("It asks for input, and nobody can answer.") from None
    except SystemExit:
        raise ProgramError("It ends its process with sys.exit; let it return the mesh.") from None


@functools.cache
def load(program: str) -> Callable[[int, Mapping[str, Any]], Any]:
    """A function of a seed and named arguments for "module:callable" or "file.py:callable".

    Raises ProgramError with a sentence.
    """
    install()
    np.random.seed(0)
    place, _, name = program.rpartition(":")
    module = _file(Path(place)) if place.endswith(".py") else _module(place)
    target = getattr(module, name, None)
    if not callable(target):
        near = [word for word, value in vars(module).items() if callable(value) and not word.startswith("_")]
        raise ProgramError(f"{place} has no function {name!r}; it has {', '.join(near[:12]) or 'none'}.")
    return functools.partial(_call_factory if hasattr(target, "spawn_asset") else _call_function, target)


def full_name(program: str) -> str:
    """`infinigen:LampFactory` with the module that defines it, found without importing any; others unchanged.

    Raises ProgramError when none or several modules define it.
    """
    package, _, name = program.partition(":")
    spec = find_spec("infinigen") if package == "infinigen" else None
    if spec is None or not spec.submodule_search_locations:
        return program
    root = Path(spec.submodule_search_locations[0]).parent
    pattern = re.compile(rf"^class {re.escape(name)}\b", re.MULTILINE)
    files = [path for path in sorted((root / FACTORIES).rglob("*.py")) if pattern.search(path.read_text())]
    modules = [".".join(path.relative_to(root).with_suffix("").parts) for path in files]
    if not name:
        raise ProgramError("Name one of Infinigen's factories, as in infinigen:LampFactory.")
    if len(modules) != 1:
        found = f"these modules have one: {', '.join(modules)}" if modules else "none of its modules has one"
        raise ProgramError(f"Infinigen's {name!r} is not clear, {found}. Name it as module:{name}.")
    return f"{modules[0]}:{name}"


def only_function(path: Path) -> str:
    """The name of the only public function of a Python file, read without running it.

    Raises ProgramError when there is no file, or none or several functions.
    """
    if not path.is_file():
        raise ProgramError(f"There is no file {path} (looked for in {Path.cwd()}).")
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (SyntaxError, ValueError) as error:
        raise ProgramError(f"{path} is no Python: {error}.") from None
    names = [n.name for n in tree.body if isinstance(n, ast.FunctionDef) and not n.name.startswith("_")]
    if len(names) != 1:
        raise ProgramError(f"Name the function of {path} with --function; it has {', '.join(names) or 'none'}.")
    return names[0]


def _call_function(target: Callable[..., Any], seed: int, arguments: Mapping[str, Any]) -> Any:
    """Call a function with a seed, or with a generator where it wants one."""
    return target(**_seeded(target, seed, arguments))


def _call_factory(target: Callable[..., Any], seed: int, arguments: Mapping[str, Any]) -> Any:
    """Make a factory of Infinigen and one asset with it."""
    own = inspect.signature(target).parameters
    settings = {name: value for name, value in arguments.items() if name in own}
    factory = target(**_seeded(target, seed, settings))
    return factory.spawn_asset(0, **{"face_size": FACE_SIZE_M} | {k: v for k, v in arguments.items() if k not in own})


def _seeded(target: Callable[..., Any], seed: int, arguments: Mapping[str, Any]) -> dict[str, Any]:
    parameters = inspect.signature(target).parameters
    named = [name for name in parameters if name in SEED_NAMES and name not in arguments]
    free = [
        p.name
        for p in parameters.values()
        if p.default is p.empty and p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY) and p.name not in arguments
    ]
    missing = [name for name in free if name not in named]
    if len(missing) == 1 and not named:
        named, missing = missing, []
    if missing:
        raise ProgramError(f"It needs the arguments {', '.join(missing)}; give them with --set {missing[0]}=VALUE.")
    return {**arguments, **{name: _random_source(parameters[name], seed) for name in named[:1]}}


def _random_source(parameter: inspect.Parameter, seed: int) -> Any:
    wanted = str(parameter.annotation)
    if "Generator" in wanted or (parameter.annotation is parameter.empty and parameter.name in GENERATOR_NAMES):
        return np.random.default_rng(seed)
    if "RandomState" in wanted:
        return np.random.RandomState(seed)
    if "Random" in wanted:
        import random

        return random.Random(seed)
    return seed


def _module(name: str) -> Any:
    if name.startswith("infinigen"):
        from dipcg.blender.infinigen import import_infinigen

        return import_infinigen(name)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise ProgramError(f"There is no module {error.name!r} here; install it, or name a file.") from None


def _file(path: Path) -> Any:
    if not path.is_file():
        raise ProgramError(f"There is no file {path} (looked for in {Path.cwd()}).")
    spec = importlib.util.spec_from_file_location(f"dipcg_program_{path.stem}", path)
    assert spec is not None, path
    assert spec.loader is not None, path
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    sys.path.insert(0, str(path.resolve().parent))
    spec.loader.exec_module(module)
    return module


def _clean() -> None:
    """Remove what an earlier run left in Blender, where that is loaded."""
    if "bpy" in sys.modules:
        from dipcg.blender.objects import clean

        clean()
