"""The error of the real parameters in x: 0 is right, 2 is the other end of the range."""

from __future__ import annotations

import numpy as np

from dipcg.space import ParameterSpace, Params

compares = "params"
unit = "x in [-1, 1]"
better = "lower"
# The truth decides which parameters count.
symmetric = False
worst = 2.0


def measure(space: ParameterSpace, truth: Params, estimate: Params) -> float:
    """Mean absolute error in x over the real parameters that are active in the truth; nan if there are none."""
    errors = [error for name, error in per_parameter(space, truth, estimate).items() if name in _reals(space)]
    return float(np.mean(errors)) if errors else float("nan")


def per_parameter(space: ParameterSpace, truth: Params, estimate: Params) -> dict[str, float]:
    """For each parameter active in the truth: the absolute error in x of a real one, 0.0 or 1.0 for a choice."""
    active = space.active(truth)
    errors = np.abs(space.encode(truth) - space.encode(estimate))
    errors[space.choices] = errors[space.choices] > 0
    return {name: float(errors[i]) for i, name in enumerate(space.names) if active[i]}


def _reals(space: ParameterSpace) -> set[str]:
    return {space.names[i] for i in space.reals}
