"""Parameters that are held while the rest is estimated: checked, and what they need of the others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from dipcg.space import ParameterSpace, Params, Value

Options = tuple[Value, ...]


def check_kept(space: ParameterSpace, keep: Mapping[str, Any]) -> Params:
    """The values to hold, read and checked.

    Raises ValueError for an unknown name, a value out of range, one that would do nothing beside another, and two that
    need different options of the same choice.
    """
    kept = {name: space.find(name)[1].check(value) for name, value in keep.items()}
    needed(space, kept)
    return kept


def needed(space: ParameterSpace, kept: Params) -> dict[str, Options]:
    """For each choice that is not held itself: the options under which everything held does something."""
    left: dict[str, tuple[str, Options]] = {}
    for name in kept:
        for choice, allowed in space.conditions(name):
            if choice in kept:
                _check_holds(name, choice, allowed, kept[choice])
            else:
                left[choice] = _narrowed(name, choice, allowed, left.get(choice))
    return {choice: options for choice, (_, options) in left.items()}


def _check_holds(name: str, choice: str, allowed: Options, value: Value) -> None:
    if value not in allowed:
        raise ValueError(
            f"{name} does nothing when {choice} is {value}; hold only one of the two, or "
            f"{choice} at {_listed(allowed)}."
        )


def _narrowed(name: str, choice: str, allowed: Options, before: tuple[str, Options] | None) -> tuple[str, Options]:
    if before is None:
        return name, allowed
    both = tuple(option for option in before[1] if option in allowed)
    if not both:
        raise ValueError(
            f"{before[0]} and {name} cannot both be held: {before[0]} needs {choice} to be {_listed(before[1])}, "
            f"{name} needs {_listed(allowed)}."
        )
    return name, both


def _listed(options: Options) -> str:
    return " or ".join(map(str, options))


def encoded(space: ParameterSpace, kept: Params, more: int) -> tuple[Float[np.ndarray, " d"], Bool[np.ndarray, " d"]]:
    """What is held as x with `more` open entries at its end, and which entries are held; the others are 0."""
    known, given = np.zeros(len(space) + more), np.zeros(len(space) + more, dtype=bool)
    for name, value in kept.items():
        index, parameter = space.find(name)
        known[index], given[index] = parameter.encode(value), True
    return known, given
