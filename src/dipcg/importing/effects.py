"""Which parameters change the mesh, and under which options of the choices, found by building."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from dipcg.importing.surfaces import moved
from dipcg.importing.trials import Trials
from dipcg.mesh import Mesh
from dipcg.space import Choice, Parameter, ParameterSpace, Params, Value

# Random contexts beside those that differ from the start in one choice.
RANDOM = 6
# Other random contexts in which a parameter must change nothing before that is believed.
DOUBTS = 6
# Options of a choice other than its own that are tried for an effect.
OTHERS = 3

# Values of all parameters, and for each parameter that was tried whether changing it alone changes the mesh.
Seen = tuple[Params, dict[str, bool]]
# The options of choices by parameter, as in `when`.
Conditions = dict[str, dict[str, tuple[Value, ...]]]


def contexts(space: ParameterSpace, start: Params, rng: np.random.Generator) -> Iterator[Params]:
    """The start, the start with each option of each choice, and draws of all choices at once."""
    yield start
    for choice in choices(space):
        yield from (start | {choice.name: option} for option in choice.options if option != start[choice.name])
    for _ in range(RANDOM if choices(space) else 0):
        yield start | {choice.name: random_option(choice.options, rng) for choice in choices(space)}


def observe(trials: Trials, parameters: Sequence[Parameter], params: Params) -> Seen:
    """For each of the parameters whether changing it changes the mesh; those whose builds all fail are left out."""
    (plain,) = trials.meshes([params])
    found: dict[str, bool] = {}
    if isinstance(plain, str):
        return params, found
    others = {p.name: list(_others(p, params[p.name])) for p in parameters}
    while others:
        tried = trials.meshes([params | {name: values[0]} for name, values in others.items()])
        for (name, values), mesh in zip(list(others.items()), tried, strict=True):
            if isinstance(mesh, Mesh):
                found[name] = moved(plain, mesh) > 0
            del values[0]
            if not values or found.get(name):
                del others[name]
    return params, found


def without_effect(trials: Trials, space: ParameterSpace, seen: Sequence[Seen], rng: np.random.Generator) -> set[str]:
    """Parameters that change the mesh neither in what was seen nor in further random draws."""
    idle = {p.name for p in space} - {name for _, found in seen for name, changes in found.items() if changes}
    for _ in range(DOUBTS):
        _, found = observe(trials, [space[name] for name in sorted(idle)], random_params(space, rng))
        idle -= {name for name, changes in found.items() if changes}
    return idle


def find_conditions(
    trials: Trials, space: ParameterSpace, seen: Sequence[Seen], rng: np.random.Generator
) -> Conditions:
    """For each parameter that matters only under some options of choices, these choices and options.

    What was seen suggests them; each option that would be excluded is tried again in random draws.
    """
    found: Conditions = {p.name: _suggested(p.name, space, seen) for p in space}
    for name, when in found.items():
        for choice in list(when):
            _confirm(trials, space, name, choice, when, rng)
    return without_circles({name: when for name, when in found.items() if when})


def choices(space: ParameterSpace) -> list[Choice]:
    return [p for p in space if isinstance(p, Choice)]


def random_option(options: Sequence[Value], rng: np.random.Generator) -> Value:
    return options[int(rng.integers(len(options)))]


def random_params(space: ParameterSpace, rng: np.random.Generator) -> Params:
    """A draw of every parameter, also of those that are inactive."""
    return {p.name: p.decode(rng.uniform(-1, 1)) for p in space}


def without_circles(found: Conditions) -> Conditions:
    """The same without conditions that lead back to the parameter that has them; the first ones stay."""
    kept: Conditions = {}
    for name, when in found.items():
        for choice, options in when.items():
            if name not in above(choice, kept):
                kept.setdefault(name, {})[choice] = options
    return kept


def above(name: str, found: Conditions) -> set[str]:
    """A parameter, and all choices that it depends on."""
    return {name}.union(*(above(choice, found) for choice in found.get(name, ())))


def _others(parameter: Parameter, value: Any) -> Iterator[Value]:
    """Other values to try: the ends of a range, the farther one first, or other options."""
    if isinstance(parameter, Choice):
        yield from [option for option in parameter.options if option != value][:OTHERS]
        return
    ends = sorted({parameter.low, parameter.high} - {value}, key=lambda end: -abs(end - value))
    yield from map(float, ends)


def _suggested(name: str, space: ParameterSpace, seen: Sequence[Seen]) -> dict[str, tuple[Value, ...]]:
    """For each choice under some of whose options alone the parameter had an effect, these options."""
    when = {}
    for choice in choices(space):
        known = [(params[choice.name], found[name]) for params, found in seen if name in found]
        working = {option for option, changes in known if changes}
        # An option that was never tried may work.
        allowed = tuple(o for o in choice.options if o in working or o not in {option for option, _ in known})
        if choice.name != name and working and len(allowed) < len(choice.options):
            when[choice.name] = allowed
    return when


def _confirm(
    trials: Trials, space: ParameterSpace, name: str, choice: str, when: dict[str, Any], rng: np.random.Generator
) -> None:
    """Try each excluded option again, with all other conditions met, and allow it when it has an effect."""
    declared = space[choice]
    assert isinstance(declared, Choice), choice
    for option in [option for option in declared.options if option not in when[choice]]:
        others = {key: random_option(options, rng) for key, options in when.items()}
        draws = [random_params(space, rng) | others | {choice: option} for _ in range(DOUBTS)]
        if any(observe(trials, [space[name]], params)[1].get(name) for params in draws):
            when[choice] = tuple(o for o in declared.options if o in when[choice] or o == option)
    if len(when[choice]) == len(declared.options):
        del when[choice]
