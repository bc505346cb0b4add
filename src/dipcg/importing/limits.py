"""The range of each input of a Blender file: what the user says, what the file says, else a proposal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from dipcg.importing.proposal import held, propose
from dipcg.space import did_you_mean

NUMBERS = ("real", "integer")

Entry = dict[str, Any]
Ask = Callable[[str], str]


def set_limits(
    entries: dict[str, Entry],
    ranges: Mapping[str, str],
    hold: Sequence[str],
    ask: Ask | None,
    side: float,
    blend: Path,
) -> dict[str, str]:
    """Give every number a range, and remove the entries that are held; returns these with the reasons.

    Raises ValueError with a sentence for a name that no input has, and for a wrong range.
    """
    _check_names([*ranges, *hold], entries, blend)
    removed = {}
    for name, entry in list(entries.items()):
        # A parameter's own range counts before that of its input: shift_x before Shift.
        given = next((key for key in _names(name, entry) if key in ranges), "")
        why = "held at its value, as you said" if set(_names(name, entry)) & set(hold) else held(entry["name"])
        if given:
            _narrow(entry, given, ranges[given])
        elif why:
            removed[entries.pop(name)["name"]] = why
        elif entry["kind"] in NUMBERS:
            _propose(entry, ask, side)
    for name in [name for name, entry in entries.items() if entry["kind"] in NUMBERS and entry["low"] == entry["high"]]:
        removed[entries.pop(name)["name"]] = "its lowest value is its highest"
    return removed


def _names(name: str, entry: Entry) -> Iterator[str]:
    yield from (name, entry["name"], entry["of"])


def _check_names(given: Sequence[str], entries: dict[str, Entry], blend: Path) -> None:
    names = {key for name, entry in entries.items() for key in _names(name, entry)}
    for key in given:
        if key not in names:
            raise ValueError(f"There is no input {key!r} in {blend}.{did_you_mean(key, sorted(names))}")


def _propose(entry: Entry, ask: Ask | None, side: float) -> None:
    proposed = propose(entry, side)
    question = f"{entry['name']} is {entry['default']:.7g}{_in_unit(entry)} and has no limits. Lowest:highest"
    answer = ask(f"{question} ({proposed.low:g}:{proposed.high:g})? ") if ask and proposed.why else ""
    if answer.strip():
        _narrow(entry, entry["name"], answer)
    else:
        entry["low"], entry["high"], entry["why"] = proposed


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
