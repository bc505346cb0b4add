"""Which parameters change the mesh, and under which options, found by building: what no declaration says."""

from __future__ import annotations

import itertools
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dipcg.importing.effects import Conditions, above, choices, random_option, random_params
from dipcg.importing.surfaces import moved
from dipcg.mesh import Mesh
from dipcg.space import Choice, ParameterSpace, Params, Real, Value

# Builds parameters in order; an error, or what is wrong in words, stands in the place of a mesh.
Build = Callable[[Iterable[Params]], Iterable[Mesh | Exception | str]]
Option = tuple[str, Value]

# Starts from which each parameter is moved, at least and at most: together they have every option of every choice.
FEWEST, MOST = 3, 6
# An option counts as one without effect after so many tries.
TRIES = 3


@dataclass
class Effects:
    """What was seen: for each parameter how far it moved the surface at most, as a share of the side, and more."""

    sizes: dict[str, float] = field(default_factory=dict)
    moved_from: dict[str, list[Params]] = field(default_factory=lambda: defaultdict(list))
    """For each parameter the starts from which it moved the surface"""
    quiet: dict[tuple[str, str, Value], int] = field(default_factory=lambda: defaultdict(int))
    """For a parameter, a choice and an option: how often the parameter stopped mattering when only that was changed"""
    failed: list[str] = field(default_factory=list)
    """Sentences of builds that failed"""
    builds: int = 0

    def without(self, space: ParameterSpace) -> list[str]:
        """The parameters that changed nothing."""
        return [name for name in space.names if not self.sizes.get(name)]

    def matters_under(self, space: ParameterSpace, name: str, choice: str, option: Value) -> bool:
        """Whether a parameter was seen to matter under an option, or without the choice."""
        return any(not space.is_active(choice, one) or one[choice] == option for one in self.moved_from[name])


@dataclass(frozen=True)
class _Trial:
    name: str
    start: Params
    changed: Params
    option: Option | None = None
    """The option that was given to a start from which the parameter mattered"""


def find_effects(space: ParameterSpace, build: Build, rng: np.random.Generator, seconds: float = 600.0) -> Effects:
    """Move every parameter from several starts, and look again under options where it seemed to do nothing.

    There, only the option is changed in a start from which the parameter matters, because in a random start something
    else may be the reason. It stops asking for builds after so many seconds.
    """
    found = Effects()
    until = time.monotonic() + seconds
    _run(space, _covered(space, space.names, rng), build, found, until)
    for _ in range(TRIES):
        _run(space, _covered(space, found.without(space), rng), build, found, until)
    for _ in range(TRIES):
        doubts = (_under(space, *key, found, rng) for key in _doubtful(space, found))
        _run(space, [trial for trial in doubts if trial], build, found, until)
    return found


def covering(space: ParameterSpace, rng: np.random.Generator) -> list[Params]:
    """Random parameters which together have every option of every choice that the others leave active."""
    every = choices(space)
    count = min(max([FEWEST, *(len(c.options) for c in every)]), MOST)
    orders = {c.name: rng.permutation(max(count, len(c.options))) for c in every}
    starts = []
    for i in range(count):
        options = {c.name: c.options[orders[c.name][i] % len(c.options)] for c in every}
        starts.append(space.canonical(random_params(space, rng) | options))
    return starts


def activated(space: ParameterSpace, name: str, rng: np.random.Generator, start: Params | None = None) -> Params:
    """Random parameters, or those of `start`, with choices changed so that `name` is active."""
    params = random_params(space, rng) if start is None else dict(start)
    waiting = [name]
    while waiting:
        for other, allowed in space[waiting.pop()].when.items():
            waiting.append(other)
            if params[other] not in allowed:
                params[other] = random_option(allowed, rng)
    return space.canonical(params)


def far_value(parameter: Real | Choice, value: Value, rng: np.random.Generator) -> Value:
    """The farther end of a real parameter's range, or another option of a choice."""
    if isinstance(parameter, Real):
        return parameter.low if parameter.encode(value) > 0 else parameter.high
    return random_option([option for option in parameter.options if option != value], rng)


def options_of(space: ParameterSpace, choice: str) -> tuple[Value, ...]:
    """The options of a choice."""
    parameter = space[choice]
    assert isinstance(parameter, Choice)
    return parameter.options


def conditions(space: ParameterSpace, names: Sequence[str], effects: Effects) -> dict[str, dict[str, Any]]:
    """`when` of each of the names: what the space declares, and the options under which there was an effect.

    Conditions that would lead back to the parameter that has them are left out.
    """
    found: Conditions = {name: dict(space[name].when) for name in names}
    without = [key for key, times in effects.quiet.items() if times >= TRIES and not effects.matters_under(space, *key)]
    for name, choice, option in without:
        if name in names and choice in names and name not in above(choice, found):
            options = tuple(o for o in found[name].get(choice, options_of(space, choice)) if o != option)
            found[name] |= {choice: options} if options else {}
    return {name: {choice: list(options) for choice, options in when.items()} for name, when in found.items()}


def _run(space: ParameterSpace, trials: Sequence[_Trial], build: Build, found: Effects, until: float) -> None:
    """Build the starts and the changed parameters, and note where there was an effect."""
    trials = sorted(trials, key=lambda trial: repr(trial.start))
    wanted = list(_interleaved(trials))
    taken = itertools.takewhile(lambda _: time.monotonic() < until, (params for _, params in wanted))
    before: Mesh | Exception | str = ""
    for (trial, _), mesh in zip(wanted, build(taken), strict=False):
        found.builds += 1
        if not isinstance(mesh, Mesh):
            found.failed.append(str(mesh))
        if trial is None:
            before = mesh
        elif isinstance(before, Mesh) and isinstance(mesh, Mesh):
            _note(space, trial, moved(before, mesh), found)


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
