"""Ranges for inputs without limits, from what a person sees of an input: its value, unit, name and limits.

Everything here is a pure function. What the mesh does with the ranges is for `probing`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

Number = float | int

# Names of inputs that change the making of the mesh and not its design; these are held at their value.
HELD = "seed resolution subdivision subdivisions subdivide subdiv lod"
# Names of effects that may be absent, so that their range begins at 0.
AMOUNTS = "bump bumpiness distortion distort noise noisiness randomness random jitter variation strength"
AMOUNTS += " intensity amount displacement displace deform bend twist wobble irregularity roughness chaos wind"
# Names of shares of something else, which end at 1.
SHARES = "scale factor ratio share fraction taper percentage proportion"
# Names of numbered options.
KINDS = "type style variant variation shape kind mode option version model"
# The number of options that are tried for a numbered option.
OPTIONS = 6
NUMBERED = "a numbered option"
# Limits so many times as wide as the proposal say what is possible and not what is meant.
LOOSE = 30.0
# The distance to which a rounded limit may differ, as a share of it.
ROUNDING = 0.05
# The range of an angle of 0, in degrees, on each side, and the half turn that every angle stays in.
TILT, HALF_TURN = 45.0, 180.0


class Proposal(NamedTuple):
    """A range and why; without a reason it comes from the source itself."""

    low: Number
    high: Number
    why: str


def held(name: str) -> str:
    """Why an input of this name is held at its value; empty for one that is a parameter."""
    words = _words(name) & set(HELD.split())
    return f"a {words.pop()} is held at its value; --range gives it a range" if words else ""


def propose(entry: Mapping[str, Any], side: float) -> Proposal:
    """A range for a number: `entry` has name, kind, default, subtype, limits (None for none) and values elsewhere.

    `side` is the longest side of the mesh in metres, the scale of a distance that is 0.
    """
    low, high = entry["low"], entry["high"]
    made = _by_value(entry, side)
    if None not in (low, high) and (entry["default"] == 0 or high - low <= LOOSE * (made.high - made.low)):
        return Proposal(low, high, "")
    return _whole(entry, _limited(_with_others(entry, made), low, high))


def rounded(value: Number) -> float:
    """The number of the fewest digits within a twentieth of a value: 0.68 gives 0.7, and 2.56 gives 2.6."""
    tried = (float(f"{value:.{digits}g}") for digits in range(1, 8))
    return next((short for short in tried if abs(short - value) <= ROUNDING * abs(value)), value)


def _by_value(entry: Mapping[str, Any], side: float) -> Proposal:
    value, words = entry["default"], _words(entry["name"])
    if entry["kind"] == "integer":
        return _integer(value, words)
    if entry["subtype"] in ("ANGLE", "EULER"):
        return _angle(value)
    if entry["subtype"] in ("FACTOR", "PERCENTAGE"):
        most = 1.0 if entry["subtype"] == "FACTOR" else 100.0
        if 0 <= value <= most:
            return Proposal(0.0, most, "a share of the whole")
    if value == 0:
        return _zero(entry["subtype"], entry["low"], side)
    if words & set(AMOUNTS.split()):
        return _ordered(0.0, 2 * value, "none to double the value")
    if words & set(SHARES.split()) and 0 < value < 1:
        return Proposal(rounded(value / 2), min(rounded(2 * value), 1.0), "half to double the value, at most 1")
    return _ordered(value / 2, 2 * value, "half to double the value")


def _integer(value: int, words: set[str]) -> Proposal:
    if words & set(KINDS.split()) and value >= 0:
        return Proposal(0, max(value, OPTIONS - 1), NUMBERED)
    if value == 0:
        return Proposal(0, 3, "up to 3, as the value is 0")
    least = max(1, abs(value) // 2)
    return _ordered(math.copysign(least, value), value * (3 if abs(value) == 1 else 2), "half to double the value")


def _angle(value: float) -> Proposal:
    if value == 0:
        return Proposal(-TILT, TILT, "a tilt to either side")
    if abs(value) > HALF_TURN:
        return _ordered(value / 2, 2 * value, "half to double the value")
    far = math.copysign(min(2 * abs(value), HALF_TURN), value)
    return _ordered(value / 2, far, "half to double the value, within a half turn")


def _zero(subtype: str, low: Number | None, side: float) -> Proposal:
    if subtype not in ("DISTANCE", "TRANSLATION", "XYZ"):
        return Proposal(0.0, 1.0, "0 to 1, as the value is 0")
    reach = rounded(side / 4)
    least = 0.0 if subtype == "DISTANCE" or low == 0 else -reach
    return Proposal(least, reach, "up to a quarter of the object, as the value is 0")


def _ordered(a: Number, b: Number, why: str) -> Proposal:
    return Proposal(rounded(min(a, b)), rounded(max(a, b)), why)


def _with_others(entry: Mapping[str, Any], made: Proposal) -> Proposal:
    """Widened to the values that the input has elsewhere in the file."""
    values = [value for value in entry["others"].values() if not made.low <= value <= made.high]
    if not values:
        return made
    named = ", ".join(name for name, value in entry["others"].items() if value in values)
    return Proposal(min(made.low, *values), max(made.high, *values), f"{made.why}, and the value in {named}")


def _limited(made: Proposal, low: Number | None, high: Number | None) -> Proposal:
    least = made.low if low is None else max(low, made.low)
    return Proposal(least, made.high if high is None else min(high, made.high), made.why)


def _whole(entry: Mapping[str, Any], made: Proposal) -> Proposal:
    whole = entry["kind"] == "integer"
    return Proposal(round(made.low), round(made.high), made.why) if whole else made


def _words(name: str) -> set[str]:
    return set(re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower().replace("_", " ").split())
