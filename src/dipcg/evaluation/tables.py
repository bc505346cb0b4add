"""What was measured, by row and case: means, intervals, and differences from the estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from dipcg.metrics import Metric

ESTIMATE = "estimate"  # the row that the others are compared with
DRAWS = 2000
AGAINST = f"against {ESTIMATE}"


@dataclass
class Table:
    """Values of every metric for every case, by row; a failed build is counted and has the worst values."""

    metrics: list[Metric]
    values: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    failures: dict[str, int] = field(default_factory=dict)

    def add(self, row: str, values: dict[str, float], failed: bool = False) -> None:
        """Append one case to a row."""
        for name, value in values.items():
            self.values.setdefault(row, {}).setdefault(name, []).append(value)
        self.failures[row] = self.failures.get(row, 0) + failed

    def mean(self, row: str, metric: str) -> float | None:
        """The mean over cases, None where the row has no such value."""
        found = self.values[row].get(metric)
        return float(np.mean(found)) if found else None

    def interval(self, row: str, metric: str) -> tuple[float, float]:
        """The 95 % bootstrap interval of the mean over cases."""
        return bootstrap(np.array(self.values[row][metric]))

    def differences(self, metric: str) -> dict[str, tuple[float, float, float]]:
        """By how much each row's mean exceeds the estimate's on the same cases, and the paired 95 % interval of that.

        Cases are drawn with both their values, so that what makes a case hard for both rows cancels. Empty without an
        estimate; rows without the metric are left out.
        """
        own = self.values.get(ESTIMATE, {}).get(metric, [])
        others = {row: found[metric] for row, found in self.values.items() if row != ESTIMATE and metric in found}
        return {row: _difference(np.array(found), np.array(own)) for row, found in others.items() if own}

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Means with intervals, differences from the estimate with theirs, and failures, as plain values."""
        table: dict[str, dict[str, Any]] = {}
        for row, found in self.values.items():
            table[row] = {name: [self.mean(row, name), *self.interval(row, name)] for name in found}
            table[row]["failures"] = self.failures[row]
        for metric in self.metrics:
            for row, difference in self.differences(metric.name).items():
                table[row].setdefault(AGAINST, {})[metric.name] = list(difference)
        return table


def bootstrap(values: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """The 95 % bootstrap interval of a mean (Efron 1979, percentiles)."""
    drawn = np.random.default_rng(0).integers(len(values), size=(DRAWS, len(values)))
    low, high = np.percentile(values[drawn].mean(1), [2.5, 97.5])
    return float(low), float(high)


def _difference(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> tuple[float, float, float]:
    return (float((a - b).mean()), *bootstrap(a - b))  # the mean of pairs' differences: one value for each case
