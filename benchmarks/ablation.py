"""The paper's table 2: every recipe trained for the same time on the same shapes, then measured on the same pictures.

Set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`. DIPCG_BENCH_MINUTES (60) of training for each,
DIPCG_BENCH_SHAPES (100) pictures of the test split, or DIPCG_BENCH_PAIRS a folder of pairs to measure on instead,
DIPCG_BENCH_RECIPES (all) names, DIPCG_BENCH_FLAGS further flags of `dipcg train` for all, such as `--device cuda`,
DIPCG_BENCH_OUT (out/ablation) the checkpoints; a recipe whose training was killed goes on.
"""

import os
import shlex
from itertools import islice
from pathlib import Path

from benchmarks.timing import header, machine, row
from benchmarks.trained import train
from dipcg.evaluation.evaluate import Plan, evaluate, pair_cases, split_cases
from dipcg.evaluation.tables import Table
from dipcg.pipeline import Inverter
from dipcg.training.recipes import RECIPES, find_recipe

MINUTES = os.environ.get("DIPCG_BENCH_MINUTES", "60")
COUNT = int(os.environ.get("DIPCG_BENCH_SHAPES", "100"))
PAIRS = os.environ.get("DIPCG_BENCH_PAIRS")
NAMES = os.environ.get("DIPCG_BENCH_RECIPES", " ".join(RECIPES)).split()
FLAGS = shlex.split(os.environ.get("DIPCG_BENCH_FLAGS", ""))
OUT = Path(os.environ.get("DIPCG_BENCH_OUT", "out/ablation"))
COLUMNS = ("chamfer", "emd", "fscore")


def main() -> None:
    data = os.environ.get("DIPCG_BENCH_DATA")
    if not data:
        print("Skipped: set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`.")
        return
    print(f"{machine()}; {MINUTES} minutes of training for each recipe\n")
    header("recipe", "million weights", "CD", "EMD", "F", "published CD", "EMD", "F")
    for name in NAMES:
        recipe = find_recipe(name)
        folder = train(data, OUT / name, "--recipe", name, "--minutes", MINUTES, *FLAGS)
        with Inverter.load(str(folder), workers=2) as inverter:
            found = _measure(inverter, data)
            weights = sum(weight.numel() for weight in inverter.model.denoiser.parameters())
        ours = [f"{found.mean('estimate', column):.3f}" for column in COLUMNS]
        theirs = [f"{value:.3f}" for value in recipe.published] if recipe.published else [""] * 3
        row(name, f"{weights / 1e6:.1f}", *ours, *theirs)


def _measure(inverter: Inverter, data: str) -> Table:
    if PAIRS:
        pairs = islice(pair_cases(PAIRS, inverter.generator.name), COUNT)
        return evaluate(inverter, pairs, Plan(2, quarter_turns=True, metrics=COLUMNS))
    return evaluate(inverter, split_cases(data, COUNT), Plan(2, metrics=COLUMNS))


if __name__ == "__main__":
    main()
