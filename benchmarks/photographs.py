"""Pictures of a test split by another renderer than training's: Cycles with Infinigen's materials, full builds.

`python -m benchmarks.photographs NAME DATA FOLDER [COUNT]` writes NAME_0001.png with NAME_0001.npz (array `points`) for
`dipcg evaluate NAME --pairs FOLDER`; pictures that are there already are not drawn again.
"""

import sys
import time
from pathlib import Path

import numpy as np

from dipcg.evaluation.photographs import photographed_cases
from dipcg.generators import load_generator

COUNT, POINTS = 100, 20_000


def main(name: str, data: str, folder: str, count: int = COUNT) -> None:
    started = time.perf_counter()
    for number, case in enumerate(photographed_cases(data, count, load_generator(name).views, folder)):
        points = case.sample(POINTS, np.random.default_rng(number))
        np.savez_compressed(Path(folder) / f"{case.name}.npz", points=points.astype(np.float32))
        print(f"{case.name} after {time.perf_counter() - started:.1f} s", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:4], *map(int, sys.argv[4:5]))  # type: ignore[arg-type]
