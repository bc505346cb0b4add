"""Which generator, and is it any of them: pictures of several test splits, tried with every checkpoint.

`DIPCG_BENCH_SETS` names folders of `dipcg dataset build`, with `:` between them; the checkpoints are those that ship.
Each generator's misfits of its own pictures are set against those of the others', as the area under the ROC curve.
"""

import os
from collections.abc import Sequence

import numpy as np

from benchmarks.timing import header, machine, row
from dipcg.evaluate import split_cases
from dipcg.pipeline import Inverter
from dipcg.rank import STRANGE, rank
from dipcg.recognise import TRIED, recognisable
from dipcg.store import Store

COUNT = int(os.environ.get("DIPCG_BENCH_SHAPES", "20"))


def main() -> None:
    folders = os.environ.get("DIPCG_BENCH_SETS", "").split(":")
    if not folders[0]:
        return print("Skipped: set DIPCG_BENCH_SETS to folders of `dipcg dataset build`, with `:` between them.")
    print(f"{machine()}, {COUNT} pictures of each test split\n")
    shown = {Store(folder).info["generator"]: folder for folder in folders}
    misfits = {name: tried(name, shown) for name in recognisable()}
    names = list(misfits)
    header("pictures of", "recognised", *(f"mean misfit of {name}" for name in names))
    for of in shown:
        table = np.array([misfits[name][of] for name in names])
        right = f"{100 * (table.argmin(0) == names.index(of)).mean():.0f} %" if of in names else ""
        row(of, right, *(f"{value:.3f}" for value in table.mean(1)))
    print()
    header("generator", "area under the curve", f"own pictures with misfit under {STRANGE:g}", "others over it")
    for name, found in misfits.items():
        others = [value for of, values in found.items() if of != name for value in values]
        if others and name in found:
            own = np.array(found[name])
            row(
                name,
                f"{area(own, others):.3f}",
                f"{(own <= STRANGE).mean():.2f}",
                f"{np.mean(np.array(others) > STRANGE):.2f}",
            )


def tried(name: str, shown: dict[str, str]) -> dict[str, list[float]]:
    """The misfits of one generator for the pictures of every data set."""
    with Inverter.load(name, workers=2) as inverter:
        return {of: [misfit(inverter, case.image) for case in split_cases(shown[of], COUNT)] for of in shown}


def misfit(inverter: Inverter, image: object) -> float:
    """What it is after ranking as few candidates as recognising does; 1 when nothing can be built."""
    found = rank(inverter.estimate(image, TRIED)).misfit  # type: ignore[arg-type]
    return 1.0 if found is None else found


def area(own: Sequence[float] | np.ndarray, others: Sequence[float]) -> float:
    """The chance that one of the others has a higher misfit than one of its own: the area under the ROC curve."""
    higher, own = np.array(others)[:, None], np.array(own)[None]
    return float((higher > own).mean() + (higher == own).mean() / 2)


if __name__ == "__main__":
    main()
