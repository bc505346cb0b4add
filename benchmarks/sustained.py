"""Chairs built by two workers for a long time: seconds of one core each, and whether they slow down."""

import os
import resource
import time

import numpy as np

from benchmarks.timing import header, machine, row
from dipcg.generators import load_generator
from dipcg.workers.pool import BuildPool

COUNT = int(os.environ.get("DIPCG_BENCH_BUILDS", "2000"))
SHARES = 4


def main() -> None:
    print(machine() + "\n")
    space, rng = load_generator("chair").space, np.random.default_rng(0)
    header("light chairs", "wall s each", "core s each (two workers)")
    with BuildPool("chair", workers=2) as pool:
        list(pool.map([space.sample(rng) for _ in range(4)]))
        for share in range(SHARES):
            wall, core = _run(pool, [space.sample(rng) for _ in range(COUNT // SHARES)])
            row(f"{share * COUNT // SHARES} to {(share + 1) * COUNT // SHARES}", f"{wall:.3f}", f"{core:.3f}")
    print(f"\nAll with their restarts: {_children_cpu() / (COUNT + 4):.3f} processor seconds each.")


def _run(pool: BuildPool, many: list) -> tuple[float, float]:
    started = time.perf_counter()
    failed = sum(isinstance(built, Exception) for built in pool.map(many))
    assert not failed, f"{failed} builds failed"
    wall = (time.perf_counter() - started) / len(many)
    return wall, 2 * wall


def _children_cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
