"""F-score: the share of each surface that the other reproduces to within a small distance."""

from __future__ import annotations

from functools import partial

from dipcg.metrics import Points
from dipcg.metrics.chamfer import nearest

unit = "share"
better = "higher"
symmetric = True
worst = 0.0


def measure(a: Points, b: Points, threshold: float = 0.02) -> float:
    """Harmonic mean of the shares of A near B and of B near A; near is closer than `threshold`.

    Points `n 3` and `m 3`, bounding box centred, longest side 1; `threshold` in longest sides.
    Source: Knapitsch et al. 2017, "Tanks and Temples", section 5.
    """
    precision, recall = (nearest(a, b) < threshold).mean(), (nearest(b, a) < threshold).mean()
    return float(2 * precision * recall / max(precision + recall, 1e-12))


variants = {f"fscore@{threshold}": partial(measure, threshold=threshold) for threshold in (0.01, 0.05)}
