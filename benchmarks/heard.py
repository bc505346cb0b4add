"""Which generator the 200 held-out sentences of `sentences.toml` ask for, most of which do not name the thing.

`DIPCG_BENCH_WRITE=FILE` fits the classifier first and writes it; otherwise the one that ships is measured.
"""

import os
import tomllib
from pathlib import Path

import torch

from benchmarks.timing import header, machine, row
from benchmarks.words import SENTENCES
from dipcg.inference.recognise_text import recognise_text
from dipcg.model.zoo import shipped
from dipcg.training.fit_text import fit


def main() -> None:
    print(machine() + "\n")
    if path := os.environ.get("DIPCG_BENCH_WRITE"):
        torch.manual_seed(0)
        fit(shipped()).save(Path(path))
    header("sentences for", "recognised", "mean chance of the one taken")
    every: list[tuple[bool, float]] = []
    for name, sentences in tomllib.loads(SENTENCES.read_text()).items():
        found = [recognise_text(sentence["text"])[0] for sentence in sentences]
        answers = [(taken == name, chance) for taken, chance in found]
        _print(name, answers)
        every += answers
    _print("all", every)


def _print(name: str, answers: list[tuple[bool, float]]) -> None:
    right, chance = (sum(column) / len(answers) for column in zip(*answers, strict=True))
    row(name, f"{right:.1%} of {len(answers)}", f"{chance:.3f}")


if __name__ == "__main__":
    main()
