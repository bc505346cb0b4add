"""Chamfer distance as image-to-3D papers print it: squared, in [-1, 1], from 16,384 points."""

from __future__ import annotations

from dipcg.metrics import Points
from dipcg.metrics.chamfer import nearest

unit = "squared halves of the longest side"
better = "lower"
symmetric = True
points = 16_384
# A failed build counts as in `chamfer`: every point is half a side from the other surface.
worst = 2.0

# From a longest side of 1 to [-1, 1].
SCALE = 2


def measure(a: Points, b: Points) -> float:
    """Mean squared distance from each point to the nearest of the other set, A to B plus B to A, in [-1, 1].

    Points `n 3` and `m 3`, bounding box centred, longest side 1. Source: Fan et al. 2017, "A point set generation
    network for 3D object reconstruction from a single image".
    """
    return float(((SCALE * nearest(a, b)) ** 2).mean() + ((SCALE * nearest(b, a)) ** 2).mean())
