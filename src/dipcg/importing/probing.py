"""Proposed ranges, shrunk by building until every mesh in them can be used and still changes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from dipcg.blender.declaration import parameter_of
from dipcg.importing.effects import contexts, find_conditions, observe, random_params, without_effect
from dipcg.importing.limits import NUMBERS
from dipcg.importing.proposal import NUMBERED
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


def probe(trials: Trials, entries: dict[str, Entry]) -> dict[str, str]:
    """Fit proposed ranges to what the mesh does, find the conditions, and remove parameters without effect.

    Returns the names of those that are removed with the reasons. The same entries give the same result.
    """
    rng = np.random.default_rng(0)
    start: Params = {name: entry["default"] for name, entry in entries.items()}
    trials.start(start)
    switched = [start, *(start | {n: not start[n]} for n, e in entries.items() if e["kind"] == "boolean")]
    for name, entry in entries.items():
        if entry["why"] == NUMBERED:
            trim_options(trials, name, entry, switched)
    _fit_defaults(entries)
    seen = [observe(trials, list(_space(entries)), context) for context in contexts(_space(entries), start, rng)]
    for name, entry in entries.items():
        context = next((params for params, found in seen if found.get(name)), None)
        if entry["kind"] in NUMBERS and entry["why"] and context is not None:
            shrink(trials, name, entry, context)
    fixed = [name for name, entry in entries.items() if entry["kind"] in NUMBERS and entry["low"] == entry["high"]]
    left_out = _remove(entries, fixed, FIXED)
    if entries:
        calm(trials, entries, rng)
        left_out |= _remove(entries, without_effect(trials, _space(entries), seen, rng), NO_EFFECT)
    if entries:
        for name, when in find_conditions(trials, _space(entries), seen, rng).items():
            entries[name]["when"] = {choice: list(options) for choice, options in when.items()}
    return left_out


def _space(entries: dict[str, Entry]) -> ParameterSpace:
    return ParameterSpace(*(parameter_of(name, entry) for name, entry in entries.items()))


def _remove(entries: dict[str, Entry], names: Iterable[str], why: str) -> dict[str, str]:
    return {entries.pop(name)["name"]: why for name in list(names)}


def _fit_defaults(entries: dict[str, Entry]) -> None:
    """Move values outside the range to its nearest end, because a default lies inside."""
    for entry in entries.values():
        if entry["kind"] in NUMBERS:
            entry["default"] = min(max(entry["default"], entry["low"]), entry["high"])


def shrink(trials: Trials, name: str, entry: Entry, context: Params) -> None:
    """Move the ends of a proposed range towards the value of a context, in which the parameter has an effect."""
    value, notes = context[name], []
    for end in ("low", "high"):
        entry[end], why = _usable_end(trials, context, name, value, entry[end])
        notes += [why] if why else []
    entry["why"] = "; ".join([entry["why"], *notes])


def trim_options(trials: Trials, name: str, entry: Entry, tried: Sequence[Params]) -> None:
    """Keep those of the numbered options, 0 and up, that give different meshes in one of the contexts."""
    numbers = range(entry["low"], entry["high"] + 1)
    for context in tried:
        meshes = trials.meshes([context | {name: number} for number in numbers])
        last = _last_option(meshes)
        if last > 0:
            entry["high"] = max(entry["low"] + last, entry["default"])
            entry["why"] = f"a numbered option; beyond {entry['high']}, nothing new comes"
            return


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


def _last_option(meshes: Sequence[Tried]) -> int:
    """The position of the last mesh before options that are all the same.

    Beyond the last option a program either repeats it or leaves the piece away, in which case the mesh is smaller than
    all others.
    """
    new = [i for i, mesh in enumerate(meshes) if isinstance(mesh, Mesh) and not _is_there(mesh, meshes[:i])]
    if len(new) < 2 or new[-1] == len(meshes) - 1:
        return len(new) and new[-1]
    sizes = [len(mesh.faces) for mesh in (meshes[i] for i in new) if isinstance(mesh, Mesh)]
    return new[-2] if sizes[-1] < min(sizes[:-1]) else new[-1]


def _is_there(mesh: Mesh, others: Sequence[Tried]) -> bool:
    return any(isinstance(other, Mesh) and not differs(mesh, other) for other in others)
