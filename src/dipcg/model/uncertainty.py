"""How much the candidates of an estimate differ, and which of them lie in their middle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from dipcg.space import ParameterSpace, Params, Real


def central_first(points: Float[np.ndarray, "n d"]) -> list[int]:
    """The order by mean distance to all others: one sample may be an outlier, the most central one seldom is."""
    distance = np.abs(points[:, None] - points[None]).mean(2)
    return np.argsort(distance.sum(1), kind="stable").tolist()


def calibrated(
    samples: Float[np.ndarray, "k d"], expected: Float[np.ndarray, " d"], scale: float, where: Bool[np.ndarray, " d"]
) -> Float[np.ndarray, "k d"]:
    """Samples in x whose distance from their expectation is multiplied by the calibration scale.

    A denoiser that is too sure draws its samples too near to what it expects.
    """
    return np.where(where, (expected + scale * (samples - expected)).clip(-1, 1), samples)


def spread(space: ParameterSpace, expected: Params, samples: Sequence[Params]) -> dict[str, float]:
    """The standard deviation of each real in natural units; of each choice the share that has the expected option."""
    spreads = {}
    for p in space:
        values = [params[p.name] for params in samples]
        if isinstance(p, Real):
            spreads[p.name] = float(np.std([float(value) for value in values]))
        else:
            spreads[p.name] = values.count(expected[p.name]) / len(values)
    return spreads
