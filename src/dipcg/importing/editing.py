"""Other ranges for the parameters of a TOML file that `dipcg generators add` has proposed."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dipcg.blender.declaration import write_declaration
from dipcg.files import write_file
from dipcg.importing.limits import NUMBERS
from dipcg.openscad.declaration import write_scad
from dipcg.space import did_you_mean
from dipcg.tracing.declaration import write_program

Entry = dict[str, Any]
Range = tuple[float, float]
_WRITERS = {"program": write_program, "scad": write_scad}


def read_parameters(path: Path) -> dict[str, Entry]:
    """The parameters of a TOML file as they stand in it; raises OSError and ValueError."""
    return tomllib.loads(path.read_text(encoding="utf-8"))["parameters"]


def edited(entries: Mapping[str, Entry], ranges: Mapping[str, Range], hold: Sequence[str]) -> dict[str, Entry]:
    """The entries with other ranges, and without those that are held at the value of the source.

    Without a held choice, parameters that exist under its other options alone are left out too. Raises ValueError with
    a sentence.
    """
    for name in (*ranges, *hold):
        if name not in entries:
            raise ValueError(f"There is no parameter {name!r}.{did_you_mean(name, list(entries))}")
    kept = {name: _ranged(name, entry, ranges.get(name)) for name, entry in entries.items() if name not in hold}
    values = {name: _value(name, entries) for name in hold if entries[name]["kind"] not in NUMBERS}
    kept = {name: _without(entry, values) for name, entry in kept.items() if _exists(entry, values)}
    # What depends on a choice that is gone with a held one exists no more either.
    while gone := [name for name, entry in kept.items() if not kept.keys() >= entry.get("when", {}).keys()]:
        kept = {name: entry for name, entry in kept.items() if name not in gone}
    if not kept:
        raise ValueError("Nothing would be left to learn; hold fewer parameters.")
    return kept


def write_edited(path: Path, proposed: Path, entries: Mapping[str, Entry]) -> None:
    """Write a TOML file with the head of the proposed one and these parameters; raises OSError."""
    top = tomllib.loads(proposed.read_text(encoding="utf-8"))
    del top["parameters"]
    writer = next((write for key, write in _WRITERS.items() if key in top), write_declaration)
    write_file(path, writer(top, entries, path))


def _ranged(name: str, entry: Entry, wanted: Range | None) -> Entry:
    if wanted is None:
        return entry
    if entry["kind"] not in NUMBERS:
        raise ValueError(f"{name} is a {entry['kind']} and has no range.")
    low, high = (round(end) for end in wanted) if entry["kind"] == "integer" else wanted
    if not low < high or not all(map(math.isfinite, (low, high))):
        raise ValueError(f"The range of {name} must rise, got {low:g} to {high:g}.")
    # Limits without a reason are those of the source itself.
    if not entry.get("why") and not entry["low"] <= low < high <= entry["high"]:
        raise ValueError(f"The source limits {name} to {entry['low']:g} to {entry['high']:g}, got {low:g} to {high:g}.")
    default = {"default": min(max(entry["default"], low), high)} if "default" in entry else {}
    return entry | {"low": low, "high": high} | default


def _value(name: str, entries: Mapping[str, Entry]) -> Any:
    """The value of a held choice; raises ValueError for one whose value decides what exists, and is not known."""
    if "default" not in entries[name] and any(name in entry.get("when", {}) for entry in entries.values()):
        raise ValueError(f"{name} decides which other parameters exist, so it cannot be held.")
    return entries[name].get("default")


def _exists(entry: Entry, values: Mapping[str, Any]) -> bool:
    when = entry.get("when", {})
    return all(values[name] in when[name] for name in when.keys() & values.keys())


def _without(entry: Entry, values: Mapping[str, Any]) -> Entry:
    when = {name: options for name, options in entry.get("when", {}).items() if name not in values}
    return entry | {"when": when}
