"""Timing shared by the benchmarks."""

import os
import time
from collections.abc import Callable

import numpy as np


def seconds(work: Callable[[], object], repeats: int = 10) -> tuple[float, float]:
    """Median and 95th percentile of the seconds that `work` takes, after one call to warm up."""
    work()
    taken = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        taken.append(time.perf_counter() - started)
    return float(np.median(taken)), float(np.percentile(taken, 95))


def row(*cells: object) -> None:
    """Print one row of a Markdown table."""
    print("| " + " | ".join(str(cell) for cell in cells) + " |", flush=True)


def header(*cells: str) -> None:
    """Print the head of a Markdown table."""
    row(*cells)
    print("|---" * len(cells) + "|", flush=True)


def machine() -> str:
    """Cores and load, because a number without them means little."""
    return f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start"
