"""The number of threads that training computes with: all processors alone, fewer beside other work.

Each step waits for its slowest thread, so on a machine with a busy neighbour fewer threads are faster.
"""

from __future__ import annotations

import time

import psutil
import torch

# Seconds between two looks at what else the machine does.
EVERY_S = 15.0
# A neighbour counts from this many busy processors on.
BUSY = 0.3


class Threads:
    """Chooses the number of threads anew every `EVERY_S` seconds; a context manager that restores the old number."""

    def __init__(self) -> None:
        # torch has counted the processors, and its users may have set a lower number.
        self._most = torch.get_num_threads()
        self._process = psutil.Process()

    def adapt(self) -> None:
        """Look at what other processes used since the last look, when that is long enough ago."""
        now = time.monotonic()
        if now - self._looked < EVERY_S:
            return
        others = (self._busy_s() - self._busy) / (now - self._looked)
        self._remember(now)
        torch.set_num_threads(threads_beside(others, self._most))

    def __enter__(self) -> Threads:
        self._remember(time.monotonic())
        return self

    def __exit__(self, *_: object) -> None:
        torch.set_num_threads(self._most)

    def _remember(self, now: float) -> None:
        self._looked, self._busy = now, self._busy_s()

    def _busy_s(self) -> float:
        """Seconds of processor time that other processes have used since the machine started."""
        every, own = psutil.cpu_times(), self._process.cpu_times()
        idle = every.idle + getattr(every, "iowait", 0.0)
        return sum(every) - idle - getattr(every, "guest", 0.0) - own.user - own.system


def threads_beside(others: float, processors: int) -> int:
    """How many threads pay beside neighbours that keep `others` processors busy; at least one."""
    return max(1, processors - (round(others + 0.5 - BUSY) if others >= BUSY else 0))
