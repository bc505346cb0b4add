"""How near the generator itself can come to real shapes: the longest search over its parameters that knows the truth.

DIPCG_BENCH_PAIRS is a folder of pictures with surface points, DIPCG_BENCH_CHECKPOINT (chair) what they show,
DIPCG_BENCH_CALLS (300) the builds for each. Some chains go on from the estimate and from random shapes, and take
nearly every step towards the points of the truth, so what is left at the end is mostly what no parameters can make.
"""

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.timing import header, machine, row
from dipcg.evaluation.evaluate import Case, distance, pair_cases
from dipcg.inference.search import Metropolis, Moves, Point, search
from dipcg.pipeline import Inverter
from dipcg.workers.process import BuildError

CHECKPOINT = os.environ.get("DIPCG_BENCH_CHECKPOINT", "chair")
CALLS = int(os.environ.get("DIPCG_BENCH_CALLS", "300"))
# The chains of the search, and how many of them start at the estimate.
CHAINS, ESTIMATED = 4, 3
# The temperature, as a difference of the chamfer distance.
COLD = 1e-4
# The size of a move, and the share of the parameters that it moves.
STEP, SHARE = 0.3, 0.06


def main() -> None:
    pairs = os.environ.get("DIPCG_BENCH_PAIRS")
    if not pairs:
        return print("Skipped: set DIPCG_BENCH_PAIRS to a folder of pictures with surface points.")
    print(f"{machine()}, {CALLS} builds each\n")
    header("picture", "estimate", "nearest found")
    found = []
    with Inverter.load(CHECKPOINT, workers=2) as inverter:
        for case in pair_cases(pairs, Path(CHECKPOINT).name):
            found.append(climb(inverter, case))
            row(case.name, *(f"{value:.3f}" for value in found[-1]))
    row("mean", *(f"{value:.3f}" for value in np.mean(found, axis=0)))
    return None


def climb(inverter: Inverter, case: Case) -> tuple[float, float]:
    """Distances of the estimate and of the nearest shape found, by 2,500 points, at the best of four quarter turns."""
    space, rng = inverter.generator.space, np.random.default_rng(0)
    start = space.encode(inverter.estimate(case.image, 1).params)
    starts = [start] * ESTIMATED + [rng.uniform(-1, 1, len(space)) for _ in range(CHAINS - ESTIMATED)]

    def score(points: Sequence[Point]) -> Iterator[float]:
        for mesh in inverter.pool.map([space.decode(point) for point in points]):
            yield math.inf if isinstance(mesh, BuildError) else distance(mesh, case, True)

    tried = list(search(Metropolis(starts, Moves(space, rng, STEP, SHARE), COLD, rng), score, CALLS))
    return tried[0].score, tried[-1].best


if __name__ == "__main__":
    main()
