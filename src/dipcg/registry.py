"""Finding plugins: a file in `generators/`, `encoders/` or `metrics/`, an entry point, or a path to a file.

The file name is the name of the plugin, and listing imports nothing. A path may come from a checkpoint, an asset or a
data set that somebody else has made, so a Python file runs only after `allow_code` has named it: the command line does
this for the paths that stand on it.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType

from dipcg.space import did_you_mean

KINDS = ("generators", "encoders", "metrics")
# The Python files that may run, and folders of which every file may.
_allowed: set[Path] = set()


class CodeError(ValueError):
    """A Python file would run that nobody has allowed; the message has the flag that allows it."""


def allow_code(*files: str | Path) -> None:
    """Let Python files of generators, encoders and metrics run, and the programs that TOML files name.

    A folder allows every file in it. Only names that the user or the program has given belong here, and none that was
    read from a file.
    """
    _allowed.update(Path(file).resolve() for file in files)


def is_allowed(path: Path) -> bool:
    """Whether a file that runs code was allowed, or a folder that it is in."""
    full = path.resolve()
    return not _allowed.isdisjoint((full, *full.parents))


def check_allowed(path: Path) -> None:
    """Raise CodeError for a file that would run code and that nobody has allowed."""
    if not is_allowed(path):
        kind = "Python file" if path.suffix == ".py" else "program in"
        raise CodeError(
            f"The {kind} {path} is named by a checkpoint, an asset or a data set, and would run with all your "
            f"rights. If you trust it, add --allow-code {path} to the command; in Python, call dipcg.allow_code."
        )


def names(kind: str) -> list[str]:
    """The names of all installed plugins of a kind, sorted, without importing any."""
    return sorted({*_shipped(kind), *_entry_points(kind)})


def is_path(name: str) -> bool:
    """Whether this is the path of a plugin's file: Python, or the TOML of a generator."""
    return name.endswith((".py", ".toml"))


def load(kind: str, name: str) -> ModuleType:
    """Import a plugin by name, or by path when the name ends in `.py`.

    Raises LookupError with the nearest name when there is none, CodeError for a file that is not allowed, and
    ValueError for one that cannot be run.
    """
    if name.endswith(".py"):
        return _load_file(Path(name))
    if name in _shipped(kind):
        return importlib.import_module(f"dipcg.{kind}.{name}")
    check(kind, name)
    with _named(f"The {kind.removesuffix('s')} {name!r} of another package"):
        return _entry_points(kind)[name].load()


def check(kind: str, name: str) -> None:
    """Raise LookupError with the nearest name when no plugin of this kind has this name."""
    installed = names(kind)
    if name in installed:
        return
    near = did_you_mean(name, installed)
    raise LookupError(f"There is no {kind.removesuffix('s')} {name!r}.{near} Installed: {', '.join(installed)}.")


def _shipped(kind: str) -> list[str]:
    folder = Path(__file__).parent / kind
    return sorted(path.stem for path in folder.glob("*.py") if not path.stem.startswith("_"))


def _entry_points(kind: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=f"dipcg.{kind}")}


def _load_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise LookupError(f"There is no file {path} (looked for in {Path.cwd()}).")
    check_allowed(path)
    spec = importlib.util.spec_from_file_location(f"dipcg_plugin_{path.stem}", path.resolve())
    assert spec is not None, path
    assert spec.loader is not None, path
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up here.
    sys.modules[spec.name] = module
    folder = str(path.resolve().parent)
    # The file may import and read others beside it.
    if folder not in sys.path:
        sys.path.append(folder)
    with _named(str(path)), contextlib.chdir(folder):
        spec.loader.exec_module(module)
    return module


@contextlib.contextmanager
def _named(what: str) -> Iterator[None]:
    """Turn any error of a plugin, which others have written, into a ValueError with a sentence."""
    try:
        yield
    except Exception as error:
        raise ValueError(f"{what} cannot be loaded, {type(error).__name__}: {error}.") from error
