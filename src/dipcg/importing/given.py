"""A TOML file that comes with its Blender file: its names and ranges are taken, where the inputs allow them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from dipcg.blender.declaration import digest, write_declaration
from dipcg.importing.blend import Entry, Options, numbered, read_inputs, row, write_checked
from dipcg.importing.imported import Imported
from dipcg.importing.limits import NUMBERS

NOTE = "Names and ranges are those of the TOML file."
NOT_GIVEN = "the TOML file does not have it"
# Why a range is narrower than the source's own, so that it may be widened again.
AS_GIVEN = "as the TOML file has it"


def take_given(blend: Path, given: Path, output: Path, program: str = "") -> Imported:
    """Write the TOML file of a generator as another has it, over inputs that Blender finds in the file.

    `program` is the Blender that reads the file, in place of ours. Raises ValueError with a sentence for a parameter
    that no input can be.
    """
    top = tomllib.loads(given.read_text(encoding="utf-8"))
    entries = top.pop("parameters")
    graph = read_inputs(blend, Options(top["object"], top.get("modifier", "")), program)
    if top.get("group", []) != graph["group"]:
        raise ValueError(f"The inputs are in the group {graph['group']}, got `group = {top.get('group', [])}`.")
    sources = {_input(entry): entry for entry in numbered(graph["inputs"]).values()}
    made = {name: _taken(name, entry, sources.get(_input(entry))) for name, entry in entries.items()}
    used = [_input(entry) for entry in made.values()]
    if len(set(used)) < len(used):
        raise ValueError("Two parameters of the TOML file set the same input; delete one.")
    top |= {"blend": blend.name, "sha256": digest(blend), "blender": program}
    top |= {key: graph[key] for key in ("object", "modifier", "group")}
    write_checked(output, write_declaration(top, made, output), program)
    rows = [row(name, entry, sources[_input(entry)]["default"]) for name, entry in made.items()]
    left_out = {entry["name"]: NOT_GIVEN for where, entry in sources.items() if where not in used}
    return Imported(output, rows, graph["skipped"] | left_out, [NOTE, *graph["notes"]])


def _input(entry: Entry) -> tuple[str, str]:
    return entry["input"], entry.get("component", "")


def _taken(name: str, entry: Entry, source: Entry | None) -> Entry:
    """An entry of the TOML file, if its input allows it."""
    if source is None:
        raise ValueError(f"{name}: the modifier has no input {' '.join(_input(entry)).strip()!r} that is free.")
    if entry["kind"] != source["kind"]:
        raise ValueError(f"{name} is a {entry['kind']} in the TOML file, but its input is a {source['kind']}.")
    unknown = [option for option in entry.get("options", []) if option not in source["options"]]
    if unknown and entry["kind"] == "menu":
        raise ValueError(f"{name} has no option {unknown[0]!r}; it has {', '.join(source['options'])}.")
    return {"why": ""} | (_ranged(name, entry, source) if entry["kind"] in NUMBERS else entry)


def _ranged(name: str, entry: Entry, source: Entry) -> Entry:
    low, high = _limits(entry)
    least, most = _limits(source)
    if (least is not None and low < least) or (most is not None and high > most):
        inside = f"{'-∞' if least is None else f'{least:g}'} to {'∞' if most is None else f'{most:g}'}"
        raise ValueError(f"The source limits {name} to {inside}, got {low:g} to {high:g}.")
    own = (low, high) == (least, most)
    return entry | {"why": "" if own else entry.get("why") or AS_GIVEN}


def _limits(entry: Entry) -> tuple[Any, Any]:
    """The range with the digits that a TOML file has."""
    low, high = (end if end is None else float(f"{end:.7g}") for end in (entry.get("low"), entry.get("high")))
    return low, high
