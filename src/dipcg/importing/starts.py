"""Parameters from which others are moved to see what they do, and values to move them to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dipcg.space import Choice, Parameter, ParameterSpace, Params, Real, Value

# Starts from which each parameter is moved, at least and at most: together they have every option of every choice.
FEWEST, MOST = 3, 6
# Draws of all choices at once, beside those that differ from the maker's values in one.
DRAWS = 6
# Other values that a parameter is moved to from the same start.
OTHERS = 3


def around(space: ParameterSpace, values: Params, rng: np.random.Generator) -> Iterator[Params]:
    """The maker's values, the same with each option of each choice, and with all choices drawn."""
    yield values
    for choice in choices(space):
        yield from (values | {choice.name: option} for option in choice.options if option != values[choice.name])
    for _ in range(DRAWS if choices(space) else 0):
        yield values | {choice.name: random_option(choice.options, rng) for choice in choices(space)}


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


def random_params(space: ParameterSpace, rng: np.random.Generator) -> Params:
    """A draw of every parameter, also of those that are inactive."""
    return {p.name: p.decode(rng.uniform(-1, 1)) for p in space}


def random_option(options: Sequence[Value], rng: np.random.Generator) -> Value:
    """One of the options, all alike."""
    return options[int(rng.integers(len(options)))]


def far_value(parameter: Parameter, value: Value, rng: np.random.Generator) -> Value:
    """The farther end of a real parameter's range, or another option of a choice."""
    if isinstance(parameter, Real):
        return parameter.low if parameter.encode(value) > 0 else parameter.high
    return random_option([option for option in parameter.options if option != value], rng)


def other_values(parameter: Parameter, value: Value) -> list[Value]:
    """The ends of a real parameter's range, the farther one first, or some other options of a choice."""
    if isinstance(parameter, Choice):
        return [option for option in parameter.options if option != value][:OTHERS]
    ends = [end for end in (parameter.low, parameter.high) if end != value]
    return sorted(map(float, ends), key=lambda end: -abs(parameter.encode(end) - parameter.encode(value)))


def choices(space: ParameterSpace) -> list[Choice]:
    """The choices of a space, in order."""
    return [p for p in space if isinstance(p, Choice)]


def options_of(space: ParameterSpace, choice: str) -> tuple[Value, ...]:
    """The options of a choice."""
    parameter = space[choice]
    assert isinstance(parameter, Choice)
    return parameter.options


def is_inside(space: ParameterSpace, params: Params) -> bool:
    """Whether the values lie in the ranges and among the options of a space; others may stand beside them."""
    return all(_has(p, params[p.name]) for p in space)


def _has(parameter: Parameter, value: Value) -> bool:
    if isinstance(parameter, Choice):
        return value in parameter.options
    return parameter.low <= float(value) <= parameter.high
