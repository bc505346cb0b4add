"""Finding plugins: a file in `generators/`, `encoders/` or `metrics/`, an entry point, or a path to a file.

The file name is the key, and listing does not import.
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


def names(kind: str) -> list[str]:
    """The names of all installed plugins of a kind, sorted, without importing any."""
    return sorted({*_shipped(kind), *_entry_points(kind)})


def is_path(name: str) -> bool:
    """Whether this names a plugin by its file: Python, or the TOML of a generator."""
    return name.endswith((".py", ".toml"))


def load(kind: str, name: str) -> ModuleType:
    """Import a plugin by name, or by path when the name ends in `.py`.

    Raises LookupError with the nearest name when there is none, and ValueError for a file that cannot be run.
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
    known = names(kind)
    if name in known:
        return
    raise LookupError(
        f"There is no {kind.removesuffix('s')} {name!r}.{did_you_mean(name, known)} Installed: {', '.join(known)}."
    )


def _shipped(kind: str) -> list[str]:
    folder = Path(__file__).parent / kind
    return sorted(path.stem for path in folder.glob("*.py") if not path.stem.startswith("_"))


def _entry_points(kind: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=f"dipcg.{kind}")}


def _load_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise LookupError(f"There is no file {path} (looked for in {Path.cwd()}).")
    spec = importlib.util.spec_from_file_location(f"dipcg_plugin_{path.stem}", path)
    assert spec is not None, path
    assert spec.loader is not None, path
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    with _named(str(path)):
        spec.loader.exec_module(module)
    return module


@contextlib.contextmanager
def _named(what: str) -> Iterator[None]:
    """Say in a sentence what cannot be loaded, whatever it raises: a stranger wrote it."""
    try:
        yield
    except Exception as error:
        raise ValueError(f"{what} cannot be loaded, {type(error).__name__}: {error}.") from error
