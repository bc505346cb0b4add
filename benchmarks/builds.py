"""Seconds of one build of every generator, light and full, in one warm worker; failed builds are counted."""

import os
import sys
import time

import numpy as np

from benchmarks.timing import header, machine, row
from dipcg import registry
from dipcg.generators import load_generator
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError

LIGHT = int(os.environ.get("DIPCG_BENCH_LIGHT", "100"))
FULL = int(os.environ.get("DIPCG_BENCH_FULL", "20"))


def main() -> None:
    print(machine() + "\n")
    header(
        *("generator", "parameters", "light: median s", "95 %", "triangles", "failed"),
        *("full: median s", "95 %", "triangles", "failed"),
    )
    for name in registry.names("generators"):
        if load_generator(name).missing:
            print(f"{name} is skipped: not installed here.")
            continue
        with BuildPool(name) as pool:
            row(name, len(pool.generator.space), *_measured(pool, "light", LIGHT), *_measured(pool, "full", FULL))


def _measured(pool: BuildPool, detail, count: int) -> list[str]:
    """Median and 95th percentile of the seconds, median triangles, failures, of the assets of seeds 0 to `count`."""
    seconds, faces, failed = [], [], 0
    pool.build(pool.generator.space.sample(np.random.default_rng(count)), detail)
    for seed in range(count):
        started = time.perf_counter()
        try:
            faces.append(len(pool.build(pool.generator.space.sample(np.random.default_rng(seed)), detail).faces))
        except BuildError as error:
            failed += 1
            print(error, error.hint, file=sys.stderr)
        seconds.append(time.perf_counter() - started)
    median, late = np.percentile(seconds, [50, 95])
    return [f"{median:.3f}", f"{late:.3f}", f"{np.median(faces):,.0f}", str(failed)]


if __name__ == "__main__":
    main()
