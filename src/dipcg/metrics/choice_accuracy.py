"""The share of choices that are right."""

from __future__ import annotations

import numpy as np

from dipcg.metrics.parameter_error import per_parameter
from dipcg.space import ParameterSpace, Params

compares = "params"
unit = "share"
better = "higher"
# The truth decides which parameters count.
symmetric = False
worst = 0.0


def measure(space: ParameterSpace, truth: Params, estimate: Params) -> float:
    """Share of the choices active in the truth that are equal in the estimate; nan if there are none."""
    errors = per_parameter(space, truth, estimate)
    wrong = [errors[space.names[i]] for i in space.choices if space.names[i] in errors]
    return 1 - float(np.mean(wrong)) if wrong else float("nan")
