"""Which generator the 200 held-out sentences of `sentences.toml` describe, most of which do not name the object.

`DIPCG_BENCH_WRITE=FILE` fits the classifier first and writes it; otherwise the one that ships is measured.
"""

import os
import tomllib
from pathlib import Path

from benchmarks.timing import header, machine, row
from benchmarks.words import SENTENCES
from dipcg.inference.recognise_text import recognise_text
from dipcg.model.zoo import shipped
from dipcg.training.fit_text import fit


def main() -> None:
    print(machine() + "\n")
    if path := os.environ.get("DIPCG_BENCH_WRITE"):
        fit(shipped()).save(Path(path))
    header("sentences for", "recognised", "mean probability of the one taken")
    every: list[tuple[bool, float]] = []
    for name, sentences in tomllib.loads(SENTENCES.read_text()).items():
        likeliest = [next(iter(recognise_text(sentence["text"]).items())) for sentence in sentences]
        results = [(taken == name, probability) for taken, probability in likeliest]
        _print(name, results)
        every += results
    _print("all", every)


def _print(name: str, results: list[tuple[bool, float]]) -> None:
    right, probability = (sum(column) / len(results) for column in zip(*results, strict=True))
    row(name, f"{right:.1%} of {len(results)}", f"{probability:.3f}")


if __name__ == "__main__":
    main()
