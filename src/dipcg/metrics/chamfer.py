"""Chamfer distance: the mean distance of each surface from the other."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from dipcg.metrics import Points

unit = "longest sides of the object"
better = "lower"
symmetric = True
# A failed build counts as if every point lay half a side from the other surface: six times what a random chair gets.
worst = 1.0


def measure(a: Points, b: Points) -> float:
    """Mean distance from each point to the nearest of the other set, A to B plus B to A, not squared.

    Points `n 3` and `m 3`, bounding box centred, longest side 1. Source: Barrow et al. 1977, "Parametric correspondence
    and chamfer matching"; summed both ways as is usual for point sets (Fan et al. 2017, without their squares).
    """
    return float(nearest(a, b).mean() + nearest(b, a).mean())


def nearest(a: Float[np.ndarray, "n 3"], b: Points) -> Float[np.ndarray, " n"]:
    """For each point of `a`, the distance to the nearest point of `b`."""
    return KDTree(b).query(a)[0]


def best_quarter_turn(a: Points, b: Points) -> Points:
    """`a` turned about Z by the quarter turn that brings it nearest to `b`.

    For data in which the front is unknown. A normalised shape stays normalised.
    """
    return min((quarter_turn(a, turns) for turns in range(4)), key=lambda turned: measure(turned, b))


def quarter_turn(points: Points, turns: int) -> Points:
    """The points turned counter-clockwise about Z by `turns` times 90°, without rounding."""
    x, y, z = points.T
    return np.stack([(x, y, z), (-y, x, z), (-x, -y, z), (y, -x, z)][turns % 4], axis=1)
