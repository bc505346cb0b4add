"""F-score as image-to-3D papers print it: within 0.1 (and 0.2) in [-1, 1], from 16,384 points."""

from __future__ import annotations

from dipcg.metrics import Points, fscore
from dipcg.metrics.squared_chamfer import SCALE

unit = "share"
better = "higher"
symmetric = True
points = 16_384
worst = 0.0


def measure(a: Points, b: Points, threshold: float = 0.1) -> float:
    """F-score with the threshold in [-1, 1]; points `n 3` and `m 3`, bounding box centred, longest side 1."""
    return fscore.measure(a, b, threshold / SCALE)


def measure_at_0_2(a: Points, b: Points) -> float:
    """The same within 0.2."""
    return measure(a, b, 0.2)


variants = {"wide_fscore@0.2": measure_at_0_2}
