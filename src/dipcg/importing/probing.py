"""Proposed ranges, shrunk by building until every mesh in them can be used and still changes."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from dipcg.blender.declaration import parameter_of
from dipcg.importing.effects import UNTRIED, Effects, conditions
from dipcg.importing.limits import NUMBERS
from dipcg.importing.numbered import trim_options
from dipcg.importing.proposal import NUMBERED
from dipcg.importing.search import find_effects, first_effects
from dipcg.importing.starts import around, random_params
from dipcg.importing.trials import Trials, Tried
from dipcg.mesh import Mesh
from dipcg.mesh.order import differs
from dipcg.space import ParameterSpace, Params

# How often an end of a range is moved halfway to the value before only the value is left.
STEPS = 6
# Random meshes, of which at most a quarter may fail, and how often all ranges are halved until that is so.
DRAWS, MOST_FAILED, HALVINGS = 12, 0.25, 3

Number = float | int
Entry = dict[str, Any]
UNCHANGED = "the mesh no longer changes"
FIXED = "no other value near its own gives a mesh that can be used"
NO_EFFECT = "it changes nothing in any trial"


def probe(trials: Trials, entries: dict[str, Entry], seconds: float) -> tuple[dict[str, str], list[str]]:
    """Fit proposed ranges to what the mesh does, find the conditions, and remove parameters without effect.

    Returns the names of those that are removed with the reasons, and sentences about the trials. The same entries give
    the same result unless the time, about so many seconds, ends before.
    """
    _start(trials, entries)
    # Blender's own start does not count.
    rng, until = np.random.default_rng(0), time.monotonic() + seconds
    starts = list(around(_space(entries), _defaults(entries), rng))
    found = first_effects(_space(entries), trials.meshes, starts, until)
    for name, entry in entries.items():
        if entry["kind"] in NUMBERS and entry["why"] and name in found.moved_from:
            shrink(trials, name, entry, found.moved_from[name][0])
    fixed = [name for name, entry in entries.items() if entry["kind"] in NUMBERS and entry["low"] == entry["high"]]
    left_out = _remove(entries, fixed, FIXED)
    if not entries:
        return left_out, []
    calm(trials, entries, rng)
    effects = find_effects(_space(entries), trials.meshes, rng, until - time.monotonic(), found.within(_space(entries)))
    return left_out | _keep_effects(entries, effects), effects.notes()


def _start(trials: Trials, entries: dict[str, Entry]) -> None:
    """Build the maker's values, and fit numbered options and defaults to what there is."""
    start = _defaults(entries)
    trials.start(start)
    switched = [start, *(start | {n: not start[n]} for n, e in entries.items() if e["kind"] == "boolean")]
    for name, entry in entries.items():
        if entry["why"] == NUMBERED:
            trim_options(trials, name, entry, switched)
    for entry in entries.values():
        # A default lies inside its range.
        if entry["kind"] in NUMBERS:
            entry["default"] = min(max(entry["default"], entry["low"]), entry["high"])


def _keep_effects(entries: dict[str, Entry], effects: Effects) -> dict[str, str]:
    """Remove what does not change the mesh, with the reasons, and say under which options the rest does."""
    left_out, space = {}, _space(entries)
    for name in effects.without(space):
        left_out |= _remove(entries, [name], NO_EFFECT if name in effects.sizes else UNTRIED)
    for name, when in conditions(space, list(entries), effects).items():
        entries[name]["when"] = when
    return left_out


def _defaults(entries: dict[str, Entry]) -> Params:
    return {name: entry["default"] for name, entry in entries.items()}


def _space(entries: dict[str, Entry]) -> ParameterSpace:
    return ParameterSpace(*(parameter_of(name, entry) for name, entry in entries.items()))


def _remove(entries: dict[str, Entry], names: Iterable[str], why: str) -> dict[str, str]:
    return {entries.pop(name)["name"]: why for name in list(names)}


def shrink(trials: Trials, name: str, entry: Entry, context: Params) -> None:
    """Move the ends of a proposed range towards the value of a context, in which the parameter has an effect."""
    value, notes = context[name], []
    for end in ("low", "high"):
        entry[end], why = _usable_end(trials, context, name, value, entry[end])
        notes += [why] if why else []
    entry["why"] = "; ".join([entry["why"], *notes])


def calm(trials: Trials, entries: dict[str, Entry], rng: np.random.Generator) -> None:
    """Halve all proposed ranges, at most a few times, while too many random meshes fail."""
    for _ in range(HALVINGS):
        space = _space(entries)
        failed = sum(isinstance(mesh, str) for mesh in trials.meshes(random_params(space, rng) for _ in range(DRAWS)))
        if failed <= MOST_FAILED * DRAWS:
            return
        for entry in _halvable(entries):
            entry["low"], entry["high"] = (midway(entry["default"], entry[end]) for end in ("low", "high"))
            entry["why"] += f"; halved, as {failed} of {DRAWS} random meshes failed"


def midway(value: Number, end: Number) -> Number:
    """The place halfway from an end to the value; for integers the one nearer to the value."""
    if isinstance(end, int):
        return value + int((end - value) / 2)
    return value + (end - value) / 2


def _halvable(entries: dict[str, Entry]) -> Iterator[Entry]:
    for entry in entries.values():
        if entry["kind"] == "real" and entry["why"]:
            yield entry


def _usable_end(trials: Trials, context: Params, name: str, value: Any, end: Number) -> tuple[Number, str]:
    """An end of the range of a parameter whose mesh can be used and is another than halfway, and what is beyond it."""
    why = ""
    for _ in range(STEPS):
        if end == value:
            break
        nearer = midway(value, end)
        problem = _problem(*trials.meshes(context | {name: place} for place in (end, nearer)))
        if not problem:
            return end, why
        end, why = nearer, f"beyond {nearer:.3g}, {problem}"
    return value, why


def _problem(made: Tried, nearer: Tried) -> str:
    if isinstance(made, str):
        return made
    return UNCHANGED if isinstance(nearer, Mesh) and not differs(made, nearer) else ""
