"""How much the candidates of an estimate differ, and which of them lie in their middle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from dipcg.space import ParameterSpace, Params, Real


def central_first(points: Float[np.ndarray, "n d"]) -> list[int]:
    """The order by mean distance to all others: one sample may be odd, the most central one seldom is."""
    distance = np.abs(points[:, None] - points[None]).mean(2)
    return np.argsort(distance.sum(1), kind="stable").tolist()


def widened(
    drawn: Float[np.ndarray, "k d"], centre: Float[np.ndarray, " d"], factor: float, where: Bool[np.ndarray, " d"]
) -> Float[np.ndarray, "k d"]:
    """Samples in x moved away from their expectation, since a denoiser that is too sure draws them too near to it."""
    return np.where(where, (centre + factor * (drawn - centre)).clip(-1, 1), drawn)


def spread(space: ParameterSpace, first: Params, drawn: Sequence[Params]) -> dict[str, float]:
    """The standard deviation of each real in natural units, and the share that agrees with the first of each choice."""
    found = {}
    for p in space:
        values = [params[p.name] for params in drawn]
        if isinstance(p, Real):
            found[p.name] = float(np.std([float(value) for value in values]))
        else:
            found[p.name] = values.count(first[p.name]) / len(values)
    return found
