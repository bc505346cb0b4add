"""A table of measured values by row and case: means, intervals, and differences from the estimate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from dipcg.metrics import Metric

# The row that the others are compared with.
ESTIMATE = "estimate"
# Resamples of a bootstrap interval.
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
        values = self.values[row].get(metric)
        return float(np.mean(values)) if values else None

    def interval(self, row: str, metric: str) -> tuple[float, float]:
        """The 95 % bootstrap interval of the mean over cases."""
        return bootstrap(np.array(self.values[row][metric]))

    def differences(self, metric: str) -> dict[str, tuple[float, float, float]]:
        """Each row's mean minus the estimate's on the same cases, and its paired 95 % interval.

        Cases are drawn with both their values, so that the difficulty of a case cancels. Empty without an estimate;
        rows without the metric are left out.
        """
        own = self.values.get(ESTIMATE, {}).get(metric, [])
        others = {row: values[metric] for row, values in self.values.items() if row != ESTIMATE and metric in values}
        return {row: _difference(np.array(values), np.array(own)) for row, values in others.items() if own}

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Means with intervals, differences from the estimate with theirs, and failures, as plain values."""
        table: dict[str, dict[str, Any]] = {}
        for row, values in self.values.items():
            table[row] = {name: [self.mean(row, name), *self.interval(row, name)] for name in values}
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
    # Each case is one value, the difference of its pair.
    return (float((a - b).mean()), *bootstrap(a - b))
