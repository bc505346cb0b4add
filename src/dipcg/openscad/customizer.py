"""Parameters of an OpenSCAD file from the comments that its Customizer reads.

Source: the manual's chapter on the Customizer. Each assignment above the first module or block is a parameter, the
comment line above it describes it, and the comment behind it limits it: `[low:high]`, `[low:step:high]`, `[high]`, or
a list of options, each as `value` or `value:label`. `/* [Group] */` starts a group; one called Hidden has none.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

Entry = dict[str, Any]

# A value begins with no space: where both could match the spaces of a long line, the search would take hours.
ASSIGNMENT = re.compile(r"^\s*(?P<name>\w+)\s*=\s*(?P<value>[^;\s][^;]*);\s*(?://\s*(?P<limits>.*))?$")
GROUP = re.compile(r"^\s*/\*\s*\[(?P<group>[^\]]*)\]\s*\*/")
COMMENT = re.compile(r"^\s*//\s*(?P<text>.*)$")
# Nothing below the first of these is a parameter.
END = re.compile(r"^\s*(module|function)\b|\{")
AXES = "xyzw"


def customizer(text: str) -> tuple[dict[str, Entry], dict[str, str]]:
    """Entries of a declaration by name, and why other variables of the file are no parameters."""
    entries: dict[str, Entry] = {}
    left_out: dict[str, str] = {}
    for name, value, limits, doc, group in _variables(text):
        made = _entries(name, _literal(value), limits.strip())
        if isinstance(made, str):
            left_out[name] = made
        for key, entry in made.items() if isinstance(made, dict) else ():
            entries[key] = {"variable": name} | entry | {"doc": doc or f"the variable {name}", "group": group}
    return entries, left_out


def _variables(text: str) -> Iterator[tuple[str, str, str, str, str]]:
    """Name, value, limits, description and group of each assignment."""
    group, doc = "", ""
    for line in text.splitlines():
        if heading := GROUP.match(line):
            group = heading["group"].strip()
        elif assignment := ASSIGNMENT.match(line):
            if group.lower() != "hidden":
                yield assignment["name"], assignment["value"].strip(), assignment["limits"] or "", doc, group
        elif END.search(line.partition("//")[0]):
            return
        comment = COMMENT.match(line)
        doc = comment["text"].strip() if comment else ""


def _entries(name: str, value: Any, limits: str) -> dict[str, Entry] | str:
    if value is None:
        return "computed from others"
    if isinstance(value, bool):
        return {name: {"kind": "boolean", "default": value}}
    bracket = re.match(r"\[(.*)\]", limits)
    inside = bracket[1] if bracket else ""
    if "," in inside:
        return {name: _menu(value, inside)}
    if isinstance(value, str):
        return "a text"
    if isinstance(value, list):
        if len(value) > len(AXES) or not all(isinstance(one, (int, float)) for one in value):
            return "a list"
        parts = zip(AXES, value, strict=False)
        return {f"{name}_{axis}": _number(one, inside) | {"component": axis} for axis, one in parts}
    if not inside and value == 0:
        return "zero, and without limits"
    return {name: _number(value, inside)}


def _menu(value: Any, inside: str) -> Entry:
    """A choice; the labels of options are for people and do not reach the program."""
    options = [_option(one.strip().partition(":")[0].strip()) for one in inside.split(",")]
    kind = type(value)
    typed = [kind(option) if kind is not str else str(option) for option in options]
    return {"kind": "menu", "options": typed, "default": value if value in typed else typed[0]}


def _number(value: float | int, inside: str) -> Entry:
    """A real or an integer; without limits, from half to twice the value."""
    steps = [float(word) for word in inside.split(":")] if inside else []
    low, high = (steps[0] if len(steps) > 1 else 0.0, steps[-1]) if steps else sorted((value / 2, value * 2))
    step = steps[1] if len(steps) == 3 else 1.0
    entry: Entry = {"unit": "units", "why": "" if steps else "half to twice the value"}
    low, high = float(low), float(high)
    default = min(max(float(value), low), high)
    if steps and all(number.is_integer() for number in (low, high, step)):
        return entry | {"kind": "integer", "low": int(low), "high": int(high), "default": round(default)}
    return entry | {"kind": "real", "low": low, "high": high, "default": default}


def _literal(text: str) -> Any:
    """The value of a literal; None for an expression."""
    try:
        return json.loads(text)
    except ValueError:
        return None


def _option(word: str) -> Any:
    value = _literal(word)
    return word if value is None or isinstance(value, list) else value
