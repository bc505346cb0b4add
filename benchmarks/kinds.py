"""Fit the classifier of kinds and measure it: pictures of training's sort of six test splits, and real ones.

`DIPCG_BENCH_SETS` names folders of `dipcg dataset build`, with `:` between them; `DIPCG_BENCH_WRITE` a file for the
classifier (the one that ships is measured when it is left out); `DIPCG_BENCH_REAL` folders of pictures that are named
by what they show, as in chair_001.png.
"""

import os
from pathlib import Path

import torch

from benchmarks.timing import header, machine, row, seconds
from dipcg.inference.classifier import ENCODER, Kinds, load_kinds
from dipcg.pipeline import Inverter
from dipcg.training.fit import fit, summaries

FITTED_ON = int(os.environ.get("DIPCG_BENCH_PICTURES", "1500"))
TESTED_ON = 256


def main() -> None:
    folders = os.environ.get("DIPCG_BENCH_SETS", "").split(":")
    if not folders[0]:
        return print("Skipped: set DIPCG_BENCH_SETS to folders of `dipcg dataset build`, with `:` between them.")
    torch.manual_seed(0)
    with Inverter.load(os.environ.get("DIPCG_BENCH_CHECKPOINT", ENCODER)) as inverter:
        kinds = _made(inverter, folders)
        header("pictures of", "recognised", "mean chance of the truth")
        for folder in folders:
            _test(kinds, inverter, folder)
        for real in filter(None, os.environ.get("DIPCG_BENCH_REAL", "").split(":")):
            _try(kinds, inverter, sorted(Path(real).glob("*.png")))
    return None


def _made(inverter: Inverter, folders: list[str]) -> Kinds:
    print(machine() + "\n")
    if not (path := os.environ.get("DIPCG_BENCH_WRITE")):
        kinds = load_kinds(inverter)
        assert kinds, "no classifier ships for this encoder; set DIPCG_BENCH_WRITE"
        return kinds
    kinds = fit(inverter, folders, FITTED_ON)
    kinds.save(Path(path))
    return kinds


def _test(kinds: Kinds, inverter: Inverter, folder: str) -> None:
    name, found = summaries(inverter, folder, TESTED_ON, "test")
    shares = torch.nn.functional.linear(found, kinds.weight, kinds.bias).softmax(1)
    right = (shares.argmax(1) == kinds.names.index(name)).float().mean()
    row(name, f"{right:.1%} of {TESTED_ON}", f"{shares[:, kinds.names.index(name)].mean():.3f}")


def _try(kinds: Kinds, inverter: Inverter, pictures: list[Path]) -> None:
    found = {path: kinds.chances(inverter, path)[0] for path in pictures}
    wrong = [
        f"{path.name} as a {name} ({chance:.2f})" for path, (name, chance) in found.items() if name not in path.name
    ]
    taken = seconds(lambda: kinds.chances(inverter, pictures[0]), 5)[0]
    print(f"\nReal pictures: {len(pictures) - len(wrong)} of {len(pictures)} recognised, {taken:.3f} s each; ", end="")
    print("wrong: " + ", ".join(wrong) + "." if wrong else "none wrong.")


if __name__ == "__main__":
    main()
