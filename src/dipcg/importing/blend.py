"""A generator from a Blender file: its inputs are read in a child process and written to a TOML file as parameters."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from dipcg.blender.declaration import digest, read_declaration, write_declaration
from dipcg.blender.temporary import temporary_folder
from dipcg.files import write_file
from dipcg.importing.imported import Imported, Row
from dipcg.space import did_you_mean

TIMEOUT_S = 120.0
NUMBERS = ("real", "integer")

Entry = dict[str, Any]
Ranges = Mapping[str, str]


def import_blend(
    blend: Path,
    name: str = "",
    ranges: Ranges | None = None,
    output: Path | None = None,
    ask: Callable[[str], str] | None = None,
) -> Imported:
    """Write the TOML file that makes a generator of an object in a Blender file.

    `ranges` has "low:high" by name of an input or parameter; for inputs that are still without limits, `ask` is called
    with a question. Raises ValueError with a sentence that says what is missing, and OSError when a file cannot be
    used.
    """
    path = _free(output or blend.with_suffix(".toml"))
    graph = read_inputs(blend, name)
    entries, left_out = _numbered(graph["inputs"]), dict(graph["skipped"])
    _set_limits(entries, ranges or {}, ask, blend)
    for key in [key for key, entry in entries.items() if entry["kind"] in NUMBERS and entry["low"] == entry["high"]]:
        left_out[entries.pop(key)["name"]] = "its lowest value is its highest"
    if not entries:
        raise ValueError(f"{blend}: no input of {graph['object']!r} can be a parameter ({_listed(left_out)}).")
    inside = Path(os.path.relpath(blend.resolve(), path.parent.resolve())).as_posix()
    top = {"doc": f"{graph['object']}, the Geometry Nodes of {blend.name}.", "blend": inside}
    top |= {"object": graph["object"], "sha256": digest(blend)}
    _write(path, write_declaration(top, entries, path))
    return Imported(path, [_row(name, entry) for name, entry in entries.items()], left_out)


def _row(name: str, entry: Entry) -> Row:
    if entry["kind"] not in NUMBERS:
        return Row(name, str(entry["default"]), ", ".join(entry["options"]) or "no, yes", "")
    return Row(name, _short(entry["default"]), f"{entry['low']:g} to {entry['high']:g}", "")


def _short(value: float | int | None) -> str:
    return "" if value is None else f"{value:g}"


def read_inputs(blend: Path, name: str = "") -> dict[str, Any]:
    """The inputs of a Geometry Nodes modifier, read in a child process; raises ValueError with a sentence."""
    if not blend.is_file():
        raise ValueError(f"There is no file {blend}.")
    if find_spec("bpy") is None:
        raise ModuleNotFoundError(f"Reading {blend} needs bpy: run `pip install 'dipcg[infinigen]'` (Python 3.11).")
    command = [sys.executable, "-P", "-m", "dipcg.blender.geometry_nodes", str(blend), name]
    folder, environment = temporary_folder()
    try:
        with folder:
            done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, env=environment)
        # Blender may print lines of its own before the description, which is the last one.
        graph = json.loads(done.stdout.strip().rpartition("\n")[2])
    except subprocess.TimeoutExpired:
        raise ValueError(f"Blender took longer than {TIMEOUT_S:g} s over {blend} and was stopped.") from None
    except ValueError:
        raise ValueError(f"Blender stopped while it read {blend}; it may be damaged. {_last_line(done)}") from None
    if "error" in graph:
        raise ValueError(graph["error"])
    return graph


def _numbered(inputs: list[Entry]) -> dict[str, Entry]:
    """Parameters by names for the command line; a vector becomes three numbers."""
    entries: dict[str, Entry] = {}
    for entry in inputs:
        for one in _components(entry):
            name = base = _identifier(one["name"])
            number = 2
            while name in entries:
                name, number = f"{base}_{number}", number + 1
            entries[name] = one
    return entries


def _components(entry: Entry) -> Iterator[Entry]:
    doc = entry["doc"] or f"the input {entry['name']}"
    if entry["kind"] != "vector":
        yield entry | {"doc": doc, "of": entry["name"]}
        return
    for letter, default in zip("xyz", entry["default"], strict=True):
        one = {"kind": "real", "component": letter, "default": default, "doc": f"{doc}, {letter.upper()}"}
        yield entry | one | {"name": f"{entry['name']} {letter}", "of": entry["name"]}


def _identifier(name: str) -> str:
    word = re.sub(r"\W+", "_", name).strip("_").lower() or "input"
    return word if word.isidentifier() else f"_{word}"


def _set_limits(entries: dict[str, Entry], ranges: Ranges, ask: Callable[[str], str] | None, blend: Path) -> None:
    """Apply the ranges, ask for those that are missing, and remove defaults that lie outside."""
    _check_names(ranges, entries, blend)
    for name, entry in entries.items():
        # A parameter's own range counts before that of its input: shift_x before Shift.
        for key in [key for key in (name, entry["name"], entry["of"]) if key in ranges][:1]:
            _narrow(entry, key, ranges[key])
    if ask:
        for entry in _endless(entries).values():
            _narrow(entry, entry["name"], ask(f"{entry['name']} has no limits. Lowest:highest{_in_unit(entry)}? "))
    missing = list(_endless(entries))
    if missing:
        example = f'--range "{missing[0]}=0:1"'
        raise ValueError(f"These inputs have no limits in {blend}: {', '.join(missing)}. Give each its own: {example}.")
    for entry in entries.values():
        if entry["kind"] in NUMBERS and not entry["low"] <= entry["default"] <= entry["high"]:
            entry["default"] = None


def _check_names(ranges: Ranges, entries: dict[str, Entry], blend: Path) -> None:
    names = {key for name, entry in entries.items() for key in (entry["of"], entry["name"], name)}
    for key in ranges:
        if key not in names:
            raise ValueError(f"There is no input {key!r} in {blend}.{did_you_mean(key, sorted(names))}")


def _endless(entries: dict[str, Entry]) -> dict[str, Entry]:
    return {name: e for name, e in entries.items() if e["kind"] in NUMBERS and None in (e["low"], e["high"])}


def _narrow(entry: Entry, key: str, text: str) -> None:
    """Give a number the limits "low:high", inside those it has."""
    try:
        low, high = (float(word) for word in text.split(":"))
    except ValueError:
        raise ValueError(f"A range is written name=low:high, like {key}=0.1:0.5, got {text!r}.") from None
    if entry["kind"] not in NUMBERS:
        raise ValueError(f"{key} is a {entry['kind']} and has no range.")
    least, most = entry["low"], entry["high"]
    if not low < high or (least is not None and low < least) or (most is not None and high > most):
        inside = f" between {'-∞' if least is None else f'{least:g}'} and {'∞' if most is None else f'{most:g}'}"
        raise ValueError(f"The range of {key} must rise and lie{inside}{_in_unit(entry)}, got {text}.")
    whole = entry["kind"] == "integer"
    entry["low"], entry["high"] = (round(low), round(high)) if whole else (low, high)


def _in_unit(entry: Entry) -> str:
    return f" in {entry['unit']}" if entry["unit"] else ""


def _free(path: Path) -> Path:
    if path.suffix != ".toml":
        raise ValueError(f"{path} must end in .toml.")
    if path.exists():
        raise ValueError(f"{path} is there already; delete it, or choose another with -o.")
    return path


def _write(path: Path, text: str) -> None:
    """Write the file, and delete it again if it cannot be read."""
    write_file(path, text)
    try:
        read_declaration(path)
    except ValueError:
        path.unlink()
        raise


def _listed(left_out: dict[str, str]) -> str:
    return "; ".join(f"{name}: {why}" for name, why in left_out.items()) or "it has none"


def _last_line(done: subprocess.CompletedProcess[str]) -> str:
    lines = done.stderr.strip().splitlines()
    return f"It said: {lines[-1]}." if lines else f"Its exit code was {done.returncode}."
