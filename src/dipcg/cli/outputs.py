"""No command writes over a file that it reads, or writes one file twice."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

# The files of a checkpoint, a data set and a search.
DATA = ("card.json", "model.safetensors", "state.safetensors", "dataset.json", "shard-*.parquet", "search.json")


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[str | Path | None]) -> None:
    """Raise ValueError where a file would be written twice, or over one that is read.

    An input may be a file, a folder with a checkpoint or a data set, or the name of a generator. Links and the case of
    letters do not make two files of one.
    """
    read = [path for name in inputs if name for path in _files(Path(name))]
    taken: set[str] = set()
    for output in (written for path in outputs if path for written in _with_companions(path)):
        place = str(output.resolve()).casefold()
        if place in taken or any(_is_same(output, path) for path in read):
            raise ValueError(f"{output} would be overwritten; choose another name or folder.")
        taken.add(place)


def _files(path: Path) -> Iterator[Path]:
    """The file itself, the files that a declaration is over, or the files of a folder that commands read."""
    if path.is_dir():
        for pattern in DATA:
            yield from path.glob(pattern)
    yield path
    if path.suffix == ".toml" and path.is_file():
        yield from _sources(path)


def _sources(path: Path) -> Iterator[Path]:
    """The files that a declaration is over; none for one that cannot be read, which is said when it is loaded."""
    try:
        top = tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        return
    program, _, _ = str(top.get("program", "")).rpartition(":")
    yield from (path.parent / str(name) for name in (top.get("blend"), top.get("scad"), program) if name)


def _with_companions(path: Path) -> tuple[Path, ...]:
    """The file, and what is written beside it."""
    return (path, path.with_suffix(".mtl")) if path.suffix.lower() == ".obj" else (path,)


def _is_same(output: Path, path: Path) -> bool:
    if output.exists() and path.exists():
        return os.path.samefile(output, path)
    return str(output.resolve()).casefold() == str(path.resolve()).casefold()
