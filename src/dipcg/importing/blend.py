"""A generator from a Blender file: its inputs are read in a child process and written to a TOML file as parameters."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from dipcg.blender.declaration import digest, read_declaration, write_declaration
from dipcg.importing.header import saved_by
from dipcg.importing.imported import Imported, Row, listed
from dipcg.importing.limits import NUMBERS, set_limits
from dipcg.importing.probing import probe
from dipcg.importing.program import allow_program, check_program
from dipcg.importing.trials import Trials
from dipcg.registry import allow_code
from dipcg.workers.rpc import Blender, BlenderError

TIMEOUT_S = 120.0
COMPONENTS = "xyz"

Entry = dict[str, Any]


@dataclass(frozen=True)
class Options:
    """What a user may say about a Blender file; the inputs are named as in Blender, or as parameters are."""

    object: str = ""
    """the object with the modifier, where several have one"""
    modifier: str = ""
    """the modifier, where the object has several; the first that has inputs when left out"""
    blender: str = ""
    """the program of another Blender, or a Python that has Blender's module"""
    ranges: Mapping[str, str] | None = None
    """lowest and highest value of inputs, as "low:high\""""
    hold: Sequence[str] = ()
    """inputs that stay as they are in the file"""
    ask: Callable[[str], str] | None = None
    """asked for the ranges of inputs without limits, in place of a proposal"""


def import_blend(
    blend: Path,
    options: Options = Options(),
    output: Path | None = None,
    report: Callable[[int], None] = lambda count: None,
    seconds: float = 600.0,
) -> Imported:
    """Write the TOML file that makes a generator of an object in a Blender file.

    Inputs without limits get a range that is proposed and tried, for about so many seconds. `report` gets the number of
    builds so far. Raises ValueError with a sentence for a file or an option that cannot be used, and OSError when a
    file cannot be read or written.
    """
    path = _free(output or blend.with_suffix(".toml"))
    program = check_program(options.blender) if options.blender else ""
    graph = read_inputs(blend, options, program)
    entries, left_out = numbered(graph["inputs"]), dict(graph["skipped"])
    left_out |= set_limits(entries, options.ranges or {}, options.hold, options.ask, graph["side"], blend)
    top = {"doc": f"{graph['object']}, the Geometry Nodes of {blend.name}.", "blend": str(blend.resolve())}
    top |= {key: graph[key] for key in ("object", "modifier", "group")} | {"sha256": digest(blend), "blender": program}
    values = {name: entry["default"] for name, entry in entries.items()}
    notes: list[str] = []
    if entries:
        with _draft(top, entries) as draft, Trials(draft, report) as trials:
            removed, notes = probe(trials, entries, seconds)
            left_out |= removed
    if not entries:
        raise ValueError(
            f"{blend}: no input of {graph['object']!r} can be a parameter ({listed(left_out, 'it has none')})."
        )
    top["blend"] = Path(os.path.relpath(blend.resolve(), path.parent.resolve())).as_posix()
    write_checked(path, write_declaration(top, entries, path), program)
    rows = [row(name, entry, values[name]) for name, entry in entries.items()]
    return Imported(path, rows, left_out, [*graph["notes"], *notes])


def read_inputs(blend: Path, options: Options, program: str = "") -> dict[str, Any]:
    """The inputs of a Geometry Nodes modifier, read in a child process; raises ValueError with a sentence."""
    if not blend.is_file():
        raise ValueError(f"There is no file {blend}.")
    arguments = (str(blend), options.object, options.modifier, saved_by(blend))
    try:
        with Blender(program) as blender:
            return blender.call("geometry_nodes:describe", *arguments, timeout_s=TIMEOUT_S)
    except BlenderError as error:
        raise ValueError(str(error)) from None


@contextlib.contextmanager
def _draft(top: Entry, entries: dict[str, Entry]) -> Iterator[Path]:
    """A declaration in a folder of its own, for trials."""
    with TemporaryDirectory(prefix="dipcg-") as folder:
        path = Path(folder) / "draft.toml"
        path.write_text(write_declaration(top, entries, path), encoding="utf-8")
        allow_code(path)
        yield path


def numbered(inputs: list[Entry]) -> dict[str, Entry]:
    """Parameters by names for the command line; a vector becomes three numbers."""
    entries: dict[str, Entry] = {}
    for one in chain.from_iterable(map(_components, inputs)):
        name = base = _identifier(one["name"])
        number = 2
        while name in entries:
            name, number = f"{base}_{number}", number + 1
        entries[name] = one | {"why": ""}
    return entries


def _components(entry: Entry) -> Iterator[Entry]:
    doc = entry["doc"] or f"the input {entry['name']}"
    if entry["kind"] != "vector":
        yield entry | {"doc": doc, "of": entry["name"]}
        return
    for i, letter in enumerate(COMPONENTS):
        others = {where: values[i] for where, values in entry["others"].items()}
        one = entry | {"kind": "real", "component": letter, "default": entry["default"][i], "others": others}
        yield one | {"name": f"{entry['name']} {letter}", "doc": f"{doc}, {letter.upper()}", "of": entry["name"]}


def _identifier(name: str) -> str:
    word = re.sub(r"\W+", "_", name).strip("_").lower() or "input"
    return word if word.isidentifier() else f"_{word}"


def _free(path: Path) -> Path:
    if path.suffix != ".toml":
        raise ValueError(f"{path} must end in .toml.")
    if path.exists():
        raise ValueError(f"{path} is there already; delete it, or choose another with -o.")
    return path


def write_checked(path: Path, text: str, program: str) -> None:
    """Write a TOML file, and delete it again if it cannot be read or names another program than the user has named."""
    path.write_text(text, encoding="utf-8")
    try:
        allow_program(path, program)
        read_declaration(path)
    except ValueError:
        path.unlink()
        raise


def row(name: str, entry: Entry, value: Any) -> Row:
    """What is shown of a parameter with its value in the Blender file."""
    if entry["kind"] in NUMBERS:
        return Row(name, f"{value:.4g}", f"{entry['low']:g} to {entry['high']:g}", entry["why"])
    options = "no, yes" if entry["kind"] == "boolean" else ", ".join(entry["options"])
    return Row(name, {False: "no", True: "yes"}.get(value, str(value)), options, entry["why"])
