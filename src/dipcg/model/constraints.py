"""Parameters that are fixed while the rest is estimated: whether they can be, and what they need of the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dipcg.space import ParameterSpace, Params, Value

Options = tuple[Value, ...]


class Fixed(NamedTuple):
    """The entries of x that are fixed: their values, which are 0 elsewhere, and the mask that says which they are.

    Of several estimates each has a row.
    """

    values: Float[Tensor, "*b d"]
    mask: Bool[Tensor, "*b d"]


def check_fixed(space: ParameterSpace, fixed: Mapping[str, Any]) -> Params:
    """The fixed values, read and checked.

    Raises ValueError for an unknown name, a value out of range, one that would do nothing beside another, and two that
    need different options of the same choice.
    """
    values = {name: space.find(name)[1].check(value) for name, value in fixed.items()}
    needed_options(space, values)
    return values


def needed_options(space: ParameterSpace, fixed: Params) -> dict[str, Options]:
    """For each choice that is not fixed itself: the options under which every fixed value does something."""
    needed: dict[str, tuple[str, Options]] = {}
    for name in fixed:
        for choice, allowed in space.conditions(name):
            if choice in fixed:
                _check_active(name, choice, allowed, fixed[choice])
            else:
                needed[choice] = _narrow(name, choice, allowed, needed.get(choice))
    return {choice: options for choice, (_, options) in needed.items()}


def encode_fixed(space: ParameterSpace, fixed: Params, free: int) -> Fixed:
    """The fixed entries of x with `free` more entries at its end, which are not fixed."""
    values, mask = torch.zeros(len(space) + free), torch.zeros(len(space) + free, dtype=torch.bool)
    for name, value in fixed.items():
        index, parameter = space.find(name)
        values[index], mask[index] = parameter.encode(value), True
    return Fixed(values, mask)


def encode_all_fixed(space: ParameterSpace, many: Sequence[Params], free: int) -> Fixed:
    """The fixed entries of several estimates, a row for each."""
    rows = [encode_fixed(space, fixed, free) for fixed in many]
    return Fixed(torch.stack([row.values for row in rows]), torch.stack([row.mask for row in rows]))


def _check_active(name: str, choice: str, allowed: Options, value: Value) -> None:
    if value not in allowed:
        raise ValueError(
            f"{name} does nothing when {choice} is {value}; hold only one of the two, or "
            f"{choice} at {_either(allowed)}."
        )


def _narrow(name: str, choice: str, allowed: Options, before: tuple[str, Options] | None) -> tuple[str, Options]:
    """The options that suit this parameter and the one before, whose name stands with them for the message."""
    if before is None:
        return name, allowed
    both = tuple(option for option in before[1] if option in allowed)
    if not both:
        raise ValueError(
            f"{before[0]} and {name} cannot both be held: {before[0]} needs {choice} to be {_either(before[1])}, "
            f"{name} needs {_either(allowed)}."
        )
    return name, both


def _either(options: Options) -> str:
    return " or ".join(map(str, options))
