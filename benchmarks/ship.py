"""Put trained checkpoints in the place of those that ship, if they are nearer: `python -m benchmarks ship [NAME …]`.

The runs and data sets are those of `python -m benchmarks.marathon`. For each named generator (all that have a run when
none is named) the calibration scale is fitted on the validation split. Then the new checkpoint and the one that ships
estimate the same pictures of unseen shapes, and those of `DIPCG_BENCH_PAIRS`, a folder of pictures with surface points.
The new one ships if its mean chamfer distance on unseen shapes is less, and if its 90 % intervals hold at least 80 % of
the true values: candidates that hardly differ say that the network is sure where it is not. If it is the one whose
features the classifier of pictures reads, the classifier is fitted anew.
"""

import os
import shutil
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from benchmarks.calibration import fit as fit_calibration
from benchmarks.marathon import BUDGETS, HOME
from benchmarks.timing import header, machine, row
from dipcg.evaluation.evaluate import Case, Plan, evaluate, pair_cases, split_cases
from dipcg.evaluation.tables import ESTIMATE, Table, bootstrap
from dipcg.inference.classifier import ENCODER, FILE
from dipcg.model.zoo import CARD, SHIPPED, WEIGHTS
from dipcg.pipeline import Inverter
from dipcg.training.fit import fit as fit_classifier

COUNT = int(os.environ.get("DIPCG_BENCH_SHAPES", "200"))
# The least share of true values that the 90 % intervals must hold.
LEAST_COVERED = 0.8
UNSEEN, PAIRS = Plan(candidates=2), Plan(candidates=2, quarter_turns=True)


def main(*names: str) -> None:
    runs = {name: HOME / "runs" / name for name in names or BUDGETS}
    found = {name: run for name, run in runs.items() if (run / CARD).is_file()}
    if missing := set(names) - found.keys():
        raise SystemExit(f"There is no checkpoint in {HOME / 'runs'} for {', '.join(sorted(missing))}.")
    print(f"{machine()}, {COUNT} unseen shapes\n")
    header("pictures of", "n", "chamfer before", "after", "difference", "F@0.02 before", "after", "ships")
    taken = [name for name, run in found.items() if _replaces(name, run)]
    if ENCODER in taken:
        _renew_classifier()


def _replaces(name: str, run: Path) -> bool:
    """Whether the run's checkpoint is nearer to unseen shapes and calibrated; then it ships from now on."""
    data = str(HOME / "data" / name)
    if (covered := fit_calibration(str(run), data)) < LEAST_COVERED:
        print(f"\n{name} does not ship: its 90 % intervals hold {covered:.0%} of the true values.")
        return False
    better = _compare(name, run, lambda: split_cases(data, COUNT), UNSEEN)
    if (pairs := os.environ.get("DIPCG_BENCH_PAIRS")) and any(Path(pairs).glob(f"{name}*.npz")):
        _compare(f"{name}, pairs", run, lambda: pair_cases(pairs, name), PAIRS)
    if better:
        for file in (WEIGHTS, CARD):
            shutil.copy(run / file, SHIPPED / name / file)
    return better


def _compare(label: str, run: Path, cases: Callable[[], Iterable[Case]], plan: Plan) -> bool:
    """Print a row for the same pictures by both checkpoints; whether the new one is nearer on the mean."""
    name = run.name
    before, after = (_measured(checkpoint, cases(), plan) for checkpoint in (name, str(run)))
    distances = [np.array(table.values[ESTIMATE]["chamfer"]) for table in (before, after)]
    apart, (low, high) = float((distances[1] - distances[0]).mean()), bootstrap(distances[1] - distances[0])
    chamfer = [f"{values.mean():.4f}" for values in distances]
    fscore = [f"{table.mean(ESTIMATE, 'fscore'):.3f}" for table in (before, after)]
    row(label, len(distances[0]), *chamfer, f"{apart:+.4f} [{low:+.4f}, {high:+.4f}]", *fscore, _yes(apart < 0))
    return apart < 0


def _measured(checkpoint: str, cases: Iterable[Case], plan: Plan) -> Table:
    with Inverter.load(checkpoint, workers=2) as inverter:
        return evaluate(inverter, cases, plan)


def _renew_classifier() -> None:
    folders = [HOME / "data" / name for name in BUDGETS]
    if missing := [folder.name for folder in folders if not folder.is_dir()]:
        return print(f"\nThe classifier needs a data set of every generator; {', '.join(missing)} is missing.")
    with Inverter.load(ENCODER) as inverter:
        fit_classifier(inverter, folders).save(FILE)
    return print("\nThe classifier of pictures is fitted anew; `python -m benchmarks classifier` measures it.")


def _yes(ships: bool) -> str:
    return "yes" if ships else "no"


if __name__ == "__main__":
    main(*sys.argv[1:])
