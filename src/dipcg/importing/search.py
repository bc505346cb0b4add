"""Which parameters change the mesh, and under which options, found by building: what no declaration says."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dipcg.importing.effects import TRIES, Effects
from dipcg.importing.starts import (
    FEWEST,
    MOST,
    OTHERS,
    activated,
    choices,
    covering,
    far_value,
    other_values,
    random_params,
)
from dipcg.importing.surfaces import moved
from dipcg.mesh import Mesh
from dipcg.space import ParameterSpace, Params, Value

# Builds parameters in order; an error, or what is wrong in words, stands in the place of a mesh.
Build = Callable[[Iterable[Params]], Iterable[Mesh | Exception | str]]
Option = tuple[str, Value]


@dataclass(frozen=True)
class _Trial:
    name: str
    start: Params
    changed: Params
    option: Option | None = None
    """The option that was given to a start from which the parameter mattered"""


def first_effects(space: ParameterSpace, build: Build, starts: Sequence[Params], until: float) -> Effects:
    """Move each parameter from one start after the other until it matters; other values follow where none does."""
    found = Effects()
    for turn, start in itertools.product(range(OTHERS), starts):
        others = {name: other_values(space[name], start[name])[turn:] for name in found.without(space)}
        trials = [_Trial(name, start, start | {name: left[0]}) for name, left in others.items() if left]
        _run(space, trials, build, found, until)
    return found


def find_effects(
    space: ParameterSpace, build: Build, rng: np.random.Generator, seconds: float = 600.0, found: Effects | None = None
) -> Effects:
    """Move every parameter from several starts, and look again under options where it seemed to do nothing.

    There, only the option is changed in a start from which the parameter matters, because in a random start something
    else may be the reason. It stops asking for builds after so many seconds. What was `found` before counts too.
    """
    found = found or Effects()
    until = time.monotonic() + seconds
    _run(space, _covered(space, space.names, rng), build, found, until)
    for _ in range(TRIES):
        _run(space, _covered(space, found.without(space), rng), build, found, until)
    for _ in range(TRIES):
        doubts = (_under(space, *key, found, rng) for key in _doubtful(space, found))
        _run(space, [trial for trial in doubts if trial], build, found, until)
    return found


def _run(space: ParameterSpace, trials: Sequence[_Trial], build: Build, found: Effects, until: float) -> None:
    """Build the starts and the changed parameters, and note where there was an effect."""
    trials = sorted(trials, key=lambda trial: repr(trial.start))
    wanted = list(_interleaved(trials))
    taken = itertools.takewhile(lambda _: time.monotonic() < until, (params for _, params in wanted))
    before: Mesh | Exception | str = ""
    built = 0
    for (trial, _), mesh in zip(wanted, build(taken), strict=False):
        built += 1
        if not isinstance(mesh, Mesh):
            found.failed.append(str(mesh))
        if trial is None:
            before = mesh
        elif isinstance(before, Mesh) and isinstance(mesh, Mesh):
            _note(space, trial, moved(before, mesh), found)
    found.builds += built
    found.is_cut_short |= built < len(wanted)


def _note(space: ParameterSpace, trial: _Trial, size: float, found: Effects) -> None:
    name = trial.name
    found.sizes[name] = max(size, found.sizes.get(name, 0.0))
    if size > 0:
        found.moved_from[name].append(trial.start)
        return
    for choice, option in _options(space, trial.start):
        found.quiet[name, choice, option] += (choice, option) == trial.option


def _interleaved(trials: Sequence[_Trial]) -> Iterator[tuple[_Trial | None, Params]]:
    """Each start once, before what was changed from it."""
    for _, same in itertools.groupby(trials, key=lambda trial: repr(trial.start)):
        group = list(same)
        yield None, group[0].start
        yield from ((trial, trial.changed) for trial in group)


def _trial(space: ParameterSpace, name: str, start: Params, rng: np.random.Generator) -> _Trial:
    return _Trial(name, start, space.canonical(start | {name: far_value(space[name], start[name], rng)}))


def _covered(space: ParameterSpace, names: Sequence[str], rng: np.random.Generator) -> list[_Trial]:
    """Trials of parameters from the same few starts."""
    starts = covering(space, rng)
    return [_trial(space, name, start, rng) for name in names for start in _active(space, name, starts, rng)]


def _active(space: ParameterSpace, name: str, starts: list[Params], rng: np.random.Generator) -> list[Params]:
    there = [start for start in starts if space.is_active(name, start)]
    return there or [activated(space, name, rng, start) for start in starts[:FEWEST]]


def _doubtful(space: ParameterSpace, found: Effects) -> list[tuple[str, str, Value]]:
    """A parameter, a choice and an option under which it was never seen to matter, as far as that is not settled."""
    few = [choice for choice in choices(space) if len(choice.options) <= MOST]
    every = [(name, choice.name, option) for name in found.moved_from for choice in few for option in choice.options]
    return [
        (name, choice, option)
        for name, choice, option in dict.fromkeys([*every, *found.quiet])
        if name != choice
        and name in found.moved_from
        and found.quiet[name, choice, option] < TRIES
        and not found.matters_under(space, name, choice, option)
    ]


def _under(
    space: ParameterSpace, name: str, choice: str, option: Value, found: Effects, rng: np.random.Generator
) -> _Trial | None:
    """A trial from where a parameter mattered, with the option in place; None where they do not go together."""
    mattered = found.moved_from[name][rng.integers(len(found.moved_from[name]))]
    kept = {other: value for other, value in mattered.items() if space.is_active(other, mattered)}
    start = space.canonical(random_params(space, rng) | kept | {choice: option})
    if not (space.is_active(name, start) and space.is_active(choice, start)):
        return None
    trial = _trial(space, name, start, rng)
    return _Trial(name, trial.start, trial.changed, (choice, option))


def _options(space: ParameterSpace, params: Params) -> list[Option]:
    return [(choice.name, params[choice.name]) for choice in choices(space) if space.is_active(choice.name, params)]
