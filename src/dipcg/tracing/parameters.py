"""From the recorded draws of several runs to parameters: names, kinds, ranges, and options."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dipcg.tracing.distributions import SIGMAS

# An integer of more values is a rounded real, because so many unordered options would be hard to learn.
MAX_OPTIONS = 16
# A draw among more integers than this is a seed, or picks from a list too long to learn.
MAX_INTEGERS = 1000

Entry = dict[str, Any]


@dataclass(frozen=True)
class Seen:
    """One component of a draw in one run, as plain values."""

    address: str
    site: str
    nth: int
    size: int
    name: str
    group: str
    line: str
    form: str
    compared: str
    material: bool
    retried: bool
    kind: str
    low: float
    high: float
    labels: tuple[Any, ...] = ()
    thresholds: tuple[float, ...] = ()


@dataclass
class Run:
    """One run of a program: its draws, and by address the share of its range that each had."""

    seen: list[Seen]
    shares: Mapping[str, float] = field(default_factory=dict)


def parameters(runs: Sequence[Run]) -> tuple[dict[str, Entry], dict[str, str]]:
    """Entries of a declaration by name, and why other draws are no parameters, by name."""
    entries: dict[str, Entry] = {}
    left_out: dict[str, str] = {}
    for address, seen in _by_address(runs).items():
        first, repeated = seen[0], _is_repeated(address, runs)
        name = free_name(_name(first, address, repeated), entries | left_out)
        entry = _entry(seen, address)
        if isinstance(entry, str):
            left_out[name] = entry
        else:
            entries[name] = entry
    return entries, left_out


def option_at(entry: Entry, share: float, seen: Seen) -> Any:
    """The option of a choice that a draw at a share of its range was in one run."""
    options = entry.get("options", (False, True))
    if "shares" not in entry:
        return options[min(int(share * len(options)), len(options) - 1)]
    cuts = sorted((t - seen.low) / (seen.high - seen.low) for t in seen.thresholds) or [0.5]
    if entry["kind"] == "boolean":
        return options[entry["shares"].index(0.0 if share < cuts[0] else 1.0)]
    edge = 0.0
    for option, middle in zip(options, entry["shares"], strict=True):
        edge = 2 * middle - edge
        if share < edge:
            return option
    return options[-1]


def free_name(name: str, taken: Iterable[str]) -> str:
    """The name, numbered where it is taken."""
    if name not in taken:
        return name
    return next(f"{name}_{number}" for number in itertools.count(2) if f"{name}_{number}" not in taken)


def _by_address(runs: Sequence[Run]) -> dict[str, list[Seen]]:
    """What was seen at each address over all runs, in the order of the program."""
    found: dict[str, list[Seen]] = defaultdict(list)
    for run in runs:
        for one in run.seen:
            found[one.address].append(one)
    return found


def _is_repeated(address: str, runs: Sequence[Run]) -> bool:
    site = address.rsplit(" ", 2)[0]
    return any(one.nth > 1 for run in runs for one in run.seen if one.site == site and not one.retried)


def _name(seen: Seen, address: str, repeated: bool) -> str:
    _, nth, index = address.rsplit(" ", 2)
    parts = [seen.name]
    if repeated:
        parts.append("others" if nth == "0" else nth)
    if seen.size > 1:
        parts.append("xyz"[int(index)] if seen.size <= 3 else str(int(index) + 1))
    return "_".join(parts)


def _entry(seen: Sequence[Seen], address: str) -> Entry | str:
    """The entry of a parameter, or why there is none."""
    first = seen[0]
    if first.material or all(one.material for one in seen):
        return "drawn for a material"
    shared = {"draw": address, "group": first.group, "doc": first.line}
    made = _MAKERS[first.kind](seen) if first.kind in _MAKERS else _NO_RANGE[first.kind]
    return made if isinstance(made, str) else made | shared


def _uniform(seen: Sequence[Seen]) -> Entry | str:
    if seen[0].compared and any(one.thresholds for one in seen):
        return _threshold(seen)
    low, high = _bounds(seen)
    if low is None or high is None:
        return _share("share", 0.0, 1.0, "of its range")
    if low == high:
        return "only one value is possible"
    return _real(min(low, high), max(low, high), seen[0].form)


def _normal(seen: Sequence[Seen]) -> Entry | str:
    mean, deviation = _bounds(seen)
    if mean is None or deviation is None:
        return _share("share", 0.0, 1.0, "of ±2σ")
    if deviation == 0:
        return "only one value is possible"
    return _real(mean - SIGMAS * deviation, mean + SIGMAS * deviation, seen[0].form)


def _integer(seen: Sequence[Seen]) -> Entry | str:
    low, high = _bounds(seen)
    most = max(one.high - one.low for one in seen)
    if most > MAX_INTEGERS:
        return "one of more than a thousand numbers, as a seed is"
    if low is None or high is None:
        return _share("share", 0.0, 1.0, "of its range") if most > 1 else "only one value is possible"
    return _counted([int(low) + i for i in range(int(high) - int(low))], low)


def _counted(options: list[Any], low: float) -> Entry | str:
    if len(options) < 2:
        return "only one value is possible"
    if len(options) <= MAX_OPTIONS:
        return {"kind": "menu", "options": options, "positions": list(range(len(options)))}
    return {"kind": "integer", "low": low, "high": low + len(options) - 1, "unit": "whole"}


def _option(seen: Sequence[Seen]) -> Entry | str:
    if len({one.labels for one in seen}) > 1:
        most = max(len(one.labels) for one in seen)
        return _share("share", 0.0, 1.0, "of its options") if 1 < most <= MAX_INTEGERS else "only one value is possible"
    options = list(seen[0].labels)
    if len(options) > MAX_INTEGERS:
        return "one of more than a thousand options"
    if len(options) > MAX_OPTIONS:
        return _share("share", 0.0, 1.0, "of its options")
    return _counted(options, 0.0)


def _threshold(seen: Sequence[Seen]) -> Entry | str:
    """A uniform draw that is compared with numbers: a choice between the pieces that they cut its range into."""
    cuts = [sorted({(t - one.low) / (one.high - one.low) for t in one.thresholds}) for one in seen if one.thresholds]
    inner = sorted({round(cut, 9) for every in cuts for cut in every if 0 < cut < 1})
    if not inner:
        return "compared with a number that is always above it, or always below"
    if max(map(len, cuts)) == 1:
        true = 0.0 if seen[0].compared == "<" else 1.0
        return {"kind": "boolean", "shares": [1 - true, true]}
    if len(inner) >= MAX_OPTIONS:
        return _share("share", 0.0, 1.0, "of its range")
    edges = [0.0, *inner, 1.0]
    middles = [(a + b) / 2 for a, b in itertools.pairwise(edges)]
    return {"kind": "menu", "options": list(range(len(middles))), "shares": middles}


def _real(low: float, high: float, form: str) -> Entry:
    if form == "log":
        return {"kind": "real", "low": math.exp(low), "high": math.exp(high), "as": "log", "unit": "units"}
    return {"kind": "real", "low": low, "high": high, "unit": "°" if form == "degrees" else "units"}


def _share(how: str, low: float, high: float, unit: str) -> Entry:
    return {"kind": "real", "low": low, "high": high, "as": how, "unit": unit}


def _bounds(seen: Sequence[Seen]) -> tuple[float | None, float | None]:
    """`low` and `high` where they are the same in all runs, and None where they depend on other draws."""
    lows, highs = {one.low for one in seen}, {one.high for one in seen}
    same = _is_one(lows) and _is_one(highs) and all(map(math.isfinite, lows | highs))
    return (seen[0].low, seen[0].high) if same else (None, None)


def _is_one(values: set[float]) -> bool:
    return max(values) - min(values) <= 1e-9 * max(map(abs, values))


_NO_RANGE = {
    "other": "an order, or another draw without a range",
    "array": "an array of too many numbers",
}
_MAKERS = {"uniform": _uniform, "normal": _normal, "integer": _integer, "option": _option}
