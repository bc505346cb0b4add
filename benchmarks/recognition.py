"""Which generator, and is it any of them: pictures of several test splits, tried with every checkpoint.

`DIPCG_BENCH_SETS` names folders of `dipcg dataset build`, with `:` between them; the checkpoints are those that ship.
Each generator's misfits of its own pictures are set against those of the others', as the area under the ROC curve, and
so is the out-of-distribution score, to which the classifier adds. Then how many pictures are doubted, by the score and
by the misfit alone.
`DIPCG_BENCH_PICTURES` may name folders, with `:` between them, of other pictures whose names begin with what they show.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.timing import header, machine, row
from dipcg.data.store import Store
from dipcg.evaluation.evaluate import split_cases
from dipcg.images import Source, cut_out
from dipcg.inference.inverters import Inverters
from dipcg.inference.rank import rank
from dipcg.inference.recognise import TRIED, doubt, out_of_distribution_score, poor_fit

COUNT = int(os.environ.get("DIPCG_BENCH_SHAPES", "20"))
# Stands between what pictures show and the folder they are from.
OF = " of "


class Look(NamedTuple):
    """A picture tried with one generator: misfit and out-of-distribution score, and whether either makes it doubted."""

    misfit: float
    score: float
    doubted: bool
    misfits: bool


# By generator, and by what the pictures show.
Looked = dict[str, dict[str, list[Look]]]


def main() -> None:
    folders = os.environ.get("DIPCG_BENCH_SETS", "").split(":")
    if not folders[0]:
        return print("Skipped: set DIPCG_BENCH_SETS to folders of `dipcg dataset build`, with `:` between them.")
    print(f"{machine()}, {COUNT} pictures of each test split\n")
    shown = pictures(folders, os.environ.get("DIPCG_BENCH_PICTURES", "").split(":"))
    with Inverters(workers=2) as inverters:
        looked = {name: tried(inverters, name, shown) for name in inverters}
    print_recognised(looked, list(shown))
    print()
    print_doubted(looked)
    return None


def pictures(sets: Sequence[str], folders: Sequence[str]) -> dict[str, list[Source]]:
    """By what they show, or that and the folder they are from."""
    found: dict[str, list[Source]] = {}
    for folder in sets:
        found[Store(folder).info["generator"]] = [case.image for case in split_cases(folder, COUNT)]
    for folder in filter(None, folders):
        for path in sorted(Path(folder).glob("*.png")):
            found.setdefault(path.stem.split("_")[0] + OF + Path(folder).name, []).append(path)
    return found


def print_recognised(looked: Looked, shown: Sequence[str]) -> None:
    names = list(looked)
    header("pictures of", "recognised", *(f"mean misfit of {name}" for name in names))
    for of in shown:
        table = np.array([[look.misfit for look in looked[name][of]] for name in names])
        truth = of.split(OF)[0]
        right = f"{100 * (table.argmin(0) == names.index(truth)).mean():.0f} %" if truth in names else ""
        row(of, right, *(f"{value:.3f}" for value in table.mean(1)))


def print_doubted(looked: Looked) -> None:
    areas = ("area under the curve of the misfit", "of the out-of-distribution score")
    header("generator", *areas, "own pictures doubted", "others doubted", "others doubted by misfit alone")
    for name, found in looked.items():
        own = [look for of, looks in found.items() if of.split(OF)[0] == name for look in looks]
        others = [look for of, looks in found.items() if of.split(OF)[0] != name for look in looks]
        if others and own:
            shares = (share(own, "doubted"), share(others, "doubted"), share(others, "misfits"))
            misfits = area([look.misfit for look in own], [look.misfit for look in others])
            both = area([look.score for look in own], [look.score for look in others])
            row(name, f"{misfits:.3f}", f"{both:.3f}", *shares)


def share(looks: Sequence[Look], what: str) -> str:
    """Of the looks, and how many they are."""
    return f"{np.mean([getattr(look, what) for look in looks]):.1%} of {len(looks)}"


def tried(inverters: Inverters, name: str, shown: dict[str, list[Source]]) -> dict[str, list[Look]]:
    """The looks of one generator at the pictures of every set."""
    looks = {of: [look(inverters, name, picture) for picture in pictures] for of, pictures in shown.items()}
    inverters[name].close()
    return looks


def look(inverters: Inverters, name: str, picture: Source) -> Look:
    """After ranking as few candidates as recognising does; the misfit is 1 when nothing can be built."""
    cutout, inverter = cut_out(picture), inverters[name]
    found, classes = rank(inverter.estimate(cutout, TRIED), inverter), inverters.classify(cutout)
    misfit = 1.0 if found.misfit is None else found.misfit
    score = out_of_distribution_score(misfit, classes[name])
    return Look(misfit, score, doubt(found, classes) is not None, poor_fit(found) is not None)


def area(own: Sequence[float] | np.ndarray, others: Sequence[float]) -> float:
    """The chance that one of the others has a higher value than one of its own: the area under the ROC curve."""
    higher, own = np.array(others)[:, None], np.array(own)[None]
    return float((higher > own).mean() + (higher == own).mean() / 2)


if __name__ == "__main__":
    main()
