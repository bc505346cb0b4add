"""Everything that ships, trained at the lowest priority: `python -m benchmarks.marathon [NAME …]`.

For each named generator, in this order (all six when none is named), it builds a data set of 20,000 shapes and trains
its estimator on as many pictures as BUDGETS says. It may be killed at any time; the same command goes on. Data sets and
runs are in the folder DIPCG_HOME (~/.cache/dipcg).
"""

import os
import sys
from pathlib import Path

from benchmarks.trained import run, train

HOME = Path(os.environ.get("DIPCG_HOME", Path.home() / ".cache" / "dipcg"))
SHAPES = 20_000
# Pictures of each generator, in the order of training.
BUDGETS = {"chair": "3.6m", "table": "2.2m", "basket": "1.8m", "vase": "1.4m", "flower": "1.1m", "dandelion": "700k"}


def main(*names: str) -> None:
    unknown = [name for name in names if name not in BUDGETS]
    if unknown:
        raise SystemExit(f"There is no budget for {', '.join(unknown)}; there is one for {', '.join(BUDGETS)}.")
    os.nice(19)
    for name in names or BUDGETS:
        data = str(HOME / "data" / name)
        print(f"{name}: {SHAPES:,} shapes in {data}, then {BUDGETS[name]} pictures in {HOME / 'runs'}", flush=True)
        run("dataset", "build", name, "--count", str(SHAPES), "-o", data, "--workers", "1")
        train(data, HOME / "runs", "--pictures", BUDGETS[name])


if __name__ == "__main__":
    main(*sys.argv[1:])
