"""Fit the classifier of pictures and measure it on augmented pictures of six test splits, and on real ones.

`DIPCG_BENCH_SETS` names folders of `dipcg dataset build`, with `:` between them; `DIPCG_BENCH_WRITE` a file for the
classifier (the one that ships is measured when it is left out); `DIPCG_BENCH_REAL` folders of pictures that are named
by what they show, as in chair_001.png.
"""

import os
from pathlib import Path

import torch

from benchmarks.timing import header, machine, row, seconds
from dipcg.inference.classifier import ENCODER, Classifier, load_classifier
from dipcg.pipeline import Inverter
from dipcg.training.fit import fit, summaries

FITTED_ON = int(os.environ.get("DIPCG_BENCH_PICTURES", "1500"))
TESTED_ON = 256


def main() -> None:
    folders = os.environ.get("DIPCG_BENCH_SETS", "").split(":")
    if not folders[0]:
        return print("Skipped: set DIPCG_BENCH_SETS to folders of `dipcg dataset build`, with `:` between them.")
    with Inverter.load(os.environ.get("DIPCG_BENCH_CHECKPOINT", ENCODER)) as inverter:
        classifier = _made(inverter, folders)
        header("pictures of", "recognised", "mean probability of the truth")
        for folder in folders:
            _test(classifier, inverter, folder)
        for real in filter(None, os.environ.get("DIPCG_BENCH_REAL", "").split(":")):
            _try(classifier, inverter, sorted(Path(real).glob("*.png")))
    return None


def _made(inverter: Inverter, folders: list[str]) -> Classifier:
    print(machine() + "\n")
    if not (path := os.environ.get("DIPCG_BENCH_WRITE")):
        classifier = load_classifier(inverter)
        assert classifier, "no classifier ships for this encoder; set DIPCG_BENCH_WRITE"
        return classifier
    classifier = fit(inverter, folders, FITTED_ON)
    classifier.save(Path(path))
    return classifier


def _test(classifier: Classifier, inverter: Inverter, folder: str) -> None:
    name, summary = summaries(inverter, folder, TESTED_ON, "test")
    shares = torch.nn.functional.linear(summary, classifier.weight, classifier.bias).softmax(1)
    label = classifier.names.index(name)
    right = (shares.argmax(1) == label).float().mean()
    row(name, f"{right:.1%} of {TESTED_ON}", f"{shares[:, label].mean():.3f}")


def _try(classifier: Classifier, inverter: Inverter, pictures: list[Path]) -> None:
    likeliest = {path: next(iter(classifier.classify(path, inverter).items())) for path in pictures}
    wrong = [f"{path.name} as a {name} ({p:.2f})" for path, (name, p) in likeliest.items() if name not in path.name]
    taken = seconds(lambda: classifier.classify(pictures[0], inverter), 5)[0]
    print(f"\nReal pictures: {len(pictures) - len(wrong)} of {len(pictures)} recognised, {taken:.3f} s each; ", end="")
    print("wrong: " + ", ".join(wrong) + "." if wrong else "none wrong.")


if __name__ == "__main__":
    main()
