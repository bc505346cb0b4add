"""How much memory a process uses with all that it has started, and how much it may use."""

from __future__ import annotations

import contextlib

import psutil

# The most memory of a worker, where half of the machine's is not less.
MOST_BYTES = 8 * 2**30


def allowed_bytes() -> int:
    """The most memory that a worker may use: two of them fit into the machine."""
    return min(MOST_BYTES, psutil.virtual_memory().total // 2)


def used_bytes(pid: int) -> int:
    """The memory that a process and all its descendants have in the machine; nothing for those that have ended."""
    total = 0
    with contextlib.suppress(psutil.NoSuchProcess):
        process = psutil.Process(pid)
        for one in (process, *process.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess):
                total += one.memory_info().rss
    return total
