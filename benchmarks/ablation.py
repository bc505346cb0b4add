"""The paper's table 2 at the scale of one machine: our recipe with one change at a time, equally many pictures each.

Set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`. DIPCG_BENCH_PICTURES (500k) to train on for each row,
DIPCG_BENCH_SHAPES (100) pictures of the test split, DIPCG_BENCH_PAIRS a folder of real pairs to measure on too,
DIPCG_BENCH_ROWS (all) names with `;` between them, DIPCG_BENCH_FLAGS further flags of `dipcg train` for all, such as
`--device cuda`, DIPCG_BENCH_OUT (out/ablation) the checkpoints; a row whose training was killed goes on. The paper's
own recipes, which need DINOv2, are rows too: name them in DIPCG_BENCH_ROWS.
"""

import os
import shlex
from dataclasses import dataclass, fields
from itertools import islice
from pathlib import Path

from benchmarks.timing import header, machine, row
from benchmarks.trained import train
from dipcg import allow_code
from dipcg.config import AugmentConfig
from dipcg.evaluation.evaluate import Plan, evaluate, pair_cases, split_cases
from dipcg.pipeline import Inverter
from dipcg.training.recipes import RECIPES

PICTURES = os.environ.get("DIPCG_BENCH_PICTURES", "500k")
COUNT = int(os.environ.get("DIPCG_BENCH_SHAPES", "100"))
PAIRS = os.environ.get("DIPCG_BENCH_PAIRS")
NAMES = [name for name in os.environ.get("DIPCG_BENCH_ROWS", "").split(";") if name]
FLAGS = shlex.split(os.environ.get("DIPCG_BENCH_FLAGS", ""))
OUT = Path(os.environ.get("DIPCG_BENCH_OUT", "out/ablation"))
COLUMNS = ("chamfer", "emd", "fscore")
# A pretrained encoder whose weights are a package, in the place of CLIP.
FROZEN = Path(__file__).parents[1] / "examples" / "efficientnet.py"


@dataclass(frozen=True)
class Row:
    """The flags of one training, and the recipe of the paper that stands in the same row of its table."""

    flags: tuple[str, ...]
    published: str | None = None


ROWS = {
    "all": Row((), "paper"),
    "one view, no augmentation": Row(
        tuple(word for field in fields(AugmentConfig) for word in (f"--augment.{field.name}", "0")), "single-view"
    ),
    "frozen pretrained encoder": Row(("--encoder", str(FROZEN)), "clip"),
    "small": Row(("--width", "96", "--depth", "2", "--heads", "3"), "small"),
    "large": Row(("--width", "384", "--depth", "8", "--heads", "12"), "large"),
    "the paper's objective": Row(("--objective", "ddpm", "--summary", "0", "--steps", "250")),
}
PUBLISHED = {name: Row(("--recipe", name), name) for name in RECIPES if name != "ours"}


def main() -> None:
    data = os.environ.get("DIPCG_BENCH_DATA")
    if not data:
        print("Skipped: set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`.")
        return
    allow_code(FROZEN)
    print(f"{machine()}; {PICTURES} pictures of training for each row\n")
    on_pairs = ["CD, real", "EMD, real", "F, real"] if PAIRS else []
    header("row", "million weights", "CD", "EMD", "F", *on_pairs, "paper: CD", "EMD", "F")
    found = {name: _row(name, data) for name in NAMES or ROWS}
    print(f"\n{orders(found)}")


def _row(name: str, data: str) -> float:
    """Train and measure one row, and print it; its CD on unseen shapes."""
    one = (ROWS | PUBLISHED)[name]
    folder = train(data, OUT / name.replace(" ", "-"), "--pictures", PICTURES, *one.flags, *FLAGS)
    with Inverter.load(str(folder), workers=2) as inverter:
        unseen = evaluate(inverter, split_cases(data, COUNT), Plan(2, metrics=COLUMNS))
        tables = [unseen]
        if PAIRS:
            pairs = islice(pair_cases(PAIRS, inverter.generator.name), COUNT)
            tables.append(evaluate(inverter, pairs, Plan(2, quarter_turns=True, metrics=COLUMNS)))
        weights = sum(weight.numel() for weight in inverter.model.parameters())
    ours = [f"{table.mean('estimate', column):.3f}" for table in tables for column in COLUMNS]
    row(name, f"{weights / 1e6:.1f}", *ours, *_theirs(one))
    distance = unseen.mean("estimate", "chamfer")
    assert distance is not None, name
    return distance


def _theirs(one: Row) -> list[str]:
    published = RECIPES[one.published].published if one.published else None
    return [f"{value:.3f}" for value in published] if published else [""] * 3


def orders(found: dict[str, float]) -> str:
    """The rows that the paper has too, best CD first, in our order and in the paper's."""
    theirs = {
        name: RECIPES[published].published[0]  # type: ignore[index]
        for name in found
        if (published := (ROWS | PUBLISHED)[name].published)
    }
    ours = sorted(theirs, key=lambda name: found[name])
    return f"Order here: {'; '.join(ours)}.\nOrder in the paper: {'; '.join(sorted(theirs, key=theirs.__getitem__))}."


if __name__ == "__main__":
    main()
