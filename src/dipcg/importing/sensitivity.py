"""Which parameters change the mesh, and under which options, found by building: what no declaration says."""

from __future__ import annotations

import itertools
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dipcg.importing.effects import Conditions, above
from dipcg.importing.surfaces import moved
from dipcg.mesh import Mesh
from dipcg.space import Choice, ParameterSpace, Params, Real, Value

# Builds parameters in order; an error stands in the place of a mesh.
Build = Callable[[Iterable[Params]], Iterable[Mesh | Exception]]

# Starts from which each parameter is moved, at least and at most: together they have every option of every choice.
FEWEST, MOST = 3, 6
# An option counts as one without effect after so many tries.
TRIES = 3


@dataclass
class Effects:
    """For each parameter how far it moved the surface at most, as a share of the side; and the options that matter."""

    sizes: dict[str, float] = field(default_factory=dict)
    when: dict[str, dict[str, tuple[Value, ...]]] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)
    """Sentences of builds that failed"""
    builds: int = 0

    def without(self, space: ParameterSpace) -> list[str]:
        """The parameters that changed nothing."""
        return [name for name in space.names if not self.sizes.get(name)]


@dataclass(frozen=True)
class _Trial:
    name: str
    start: Params
    changed: Params


def find_effects(space: ParameterSpace, build: Build, rng: np.random.Generator, seconds: float = 600.0) -> Effects:
    """Move every parameter from several starts, and look again under options where it seemed to do nothing.

    It stops asking for builds after so many seconds.
    """
    found = Effects()
    until = time.monotonic() + seconds
    counts: dict[tuple[str, str, Value], Counter[bool]] = defaultdict(Counter)
    starts = covering(space, rng)
    trials = [_trial(space, name, start, rng) for name in space.names for start in _active(space, name, starts, rng)]
    _run(space, trials, build, found, counts, until)
    for _ in range(TRIES):
        doubtful = [key for key, seen in counts.items() if _is_doubtful(key, seen, found)]
        again = [t for key in doubtful if (t := _under(space, *key, rng))]
        again += [_trial(space, name, activated(space, name, rng), rng) for name in found.without(space)]
        if not again:
            break
        _run(space, again, build, found, counts, until)
    for (name, choice, option), seen in counts.items():
        if found.sizes.get(name) and not seen[True] and seen[False] >= TRIES and name != choice:
            options = found.when.setdefault(name, {}).setdefault(choice, _allowed(space, name, choice))
            found.when[name][choice] = tuple(o for o in options if o != option)
    return found


def covering(space: ParameterSpace, rng: np.random.Generator) -> list[Params]:
    """Random parameters which together have every option of every choice that the others leave active."""
    choices = [p for p in space if isinstance(p, Choice)]
    count = min(max([FEWEST, *(len(c.options) for c in choices)]), MOST)
    orders = {c.name: rng.permutation(max(count, len(c.options))) for c in choices}
    starts = []
    for i in range(count):
        params = {p.name: p.decode(rng.uniform(-1, 1)) for p in space}
        params |= {c.name: c.options[orders[c.name][i] % len(c.options)] for c in choices}
        starts.append(space.canonical(params))
    return starts


def activated(space: ParameterSpace, name: str, rng: np.random.Generator, start: Params | None = None) -> Params:
    """Random parameters, or those of `start`, with choices changed so that `name` is active."""
    params = {p.name: p.decode(rng.uniform(-1, 1)) for p in space} if start is None else dict(start)
    waiting = [name]
    while waiting:
        for other, allowed in space[waiting.pop()].when.items():
            waiting.append(other)
            if params[other] not in allowed:
                params[other] = allowed[rng.integers(len(allowed))]
    return space.canonical(params)


def far_value(parameter: Real | Choice, value: Value, rng: np.random.Generator) -> Value:
    """The farther end of a real parameter's range, or another option of a choice."""
    if isinstance(parameter, Real):
        return parameter.low if parameter.encode(value) > 0 else parameter.high
    others = [option for option in parameter.options if option != value]
    return others[rng.integers(len(others))]


def conditions(space: ParameterSpace, names: Sequence[str], effects: Effects) -> dict[str, dict[str, Any]]:
    """`when` of each of the names: what the space declares, and the options under which there was an effect.

    Conditions that would lead back to the parameter that has them are left out.
    """
    found: Conditions = {name: dict(space[name].when) for name in names}
    for name, choice in [(one, choice) for one in names for choice in effects.when.get(one, {})]:
        declared = space[name].when.get(choice)
        options = tuple(o for o in effects.when[name][choice] if declared is None or o in declared)
        if options and choice in names and name not in above(choice, found):
            found[name][choice] = options
    return {name: {choice: list(options) for choice, options in when.items()} for name, when in found.items()}


def _run(
    space: ParameterSpace,
    trials: Sequence[_Trial],
    build: Build,
    found: Effects,
    counts: dict[tuple[str, str, Value], Counter[bool]],
    until: float,
) -> None:
    """Build the starts and the changed parameters, and count under which options there was an effect."""
    trials = sorted(trials, key=lambda trial: repr(trial.start))
    wanted = list(_interleaved(trials))
    taken = itertools.takewhile(lambda _: time.monotonic() < until, (params for _, params in wanted))
    before: Mesh | Exception | None = None
    for (trial, _), mesh in zip(wanted, build(taken), strict=False):
        found.builds += 1
        if isinstance(mesh, Exception):
            found.failed.append(str(mesh))
        if trial is None:
            before = mesh
        elif isinstance(before, Mesh) and isinstance(mesh, Mesh):
            size = moved(before, mesh)
            found.sizes[trial.name] = max(size, found.sizes.get(trial.name, 0.0))
            for choice, option in _options(space, trial.start):
                counts[trial.name, choice, option][size > 0] += 1


def _interleaved(trials: Sequence[_Trial]) -> Iterator[tuple[_Trial | None, Params]]:
    """Each start once, before what was changed from it."""
    for _, same in itertools.groupby(trials, key=lambda trial: repr(trial.start)):
        group = list(same)
        yield None, group[0].start
        yield from ((trial, trial.changed) for trial in group)


def _trial(space: ParameterSpace, name: str, start: Params, rng: np.random.Generator) -> _Trial:
    return _Trial(name, start, space.canonical(start | {name: far_value(space[name], start[name], rng)}))


def _active(space: ParameterSpace, name: str, starts: list[Params], rng: np.random.Generator) -> list[Params]:
    there = [start for start in starts if space.is_active(name, start)]
    return there or [activated(space, name, rng, start) for start in starts[:FEWEST]]


def _is_doubtful(key: tuple[str, str, Value], seen: Counter[bool], found: Effects) -> bool:
    name, choice, _ = key
    return name != choice and bool(found.sizes.get(name)) and not seen[True] and seen[False] < TRIES


def _under(space: ParameterSpace, name: str, choice: str, option: Any, rng: np.random.Generator) -> _Trial | None:
    """A trial of a parameter with a choice at an option; None where they do not go together."""
    start = activated(space, name, rng, activated(space, choice, rng) | {choice: option})
    fits = space.is_active(name, start) and space.is_active(choice, start) and start[choice] == option
    return _trial(space, name, start, rng) if fits else None


def _options(space: ParameterSpace, params: Params) -> list[tuple[str, Value]]:
    return [(p.name, params[p.name]) for p in space if isinstance(p, Choice) and space.is_active(p.name, params)]


def _allowed(space: ParameterSpace, name: str, choice: str) -> tuple[Value, ...]:
    parameter = space[choice]
    assert isinstance(parameter, Choice)
    return space[name].when.get(choice, parameter.options)
