"""How much of what 200 held-out sentences ask for comes true: `python -m benchmarks.words [RUNS]`.

`sentences.toml` was written without a look at the grammar that training captions come from. An asked-for option
has to be the one in the estimate, and active; a real asked to be high or low, in that half of its range. Beside it a
random asset. RUNS is a folder with a checkpoint for each generator; the shipped ones when left out.
"""

import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.timing import header, row
from dipcg.model.zoo import WORDS
from dipcg.pipeline import Inverter
from dipcg.space import Choice, ParameterSpace, Params

SENTENCES = Path(__file__).with_name("sentences.toml")


def main(runs: str = str(WORDS)) -> None:
    header("generator", "sentences", "choices asked, true", "by chance", "highs and lows asked, true", "by chance")
    totals = np.zeros((2, 2, 2))
    for name, sentences in tomllib.loads(SENTENCES.read_text()).items():
        folder = Path(runs) / name
        if not folder.is_dir():
            print(f"{name} is skipped: there is no checkpoint in {Path(runs).name}.")
            continue
        found = _measured(str(folder), sentences)
        totals += found
        _print(name, len(sentences), found)
    _print("all", "", totals)


def _measured(checkpoint: str, sentences: list[dict]) -> np.ndarray:
    """Asked and true, by [kind: choice or real][of: estimate or random asset]."""
    counts = np.zeros((2, 2, 2))
    with Inverter.load(checkpoint) as inverter:
        space, rng = inverter.generator.space, np.random.default_rng(0)
        for sentence in sentences:
            estimate = inverter.describe(sentence["text"], candidates=1).params
            for of, params in enumerate((estimate, space.sample(rng))):
                for name, wanted in sentence["asked"].items():
                    counts[int(not isinstance(space[name], Choice)), of] += (1, _is_true(space, params, name, wanted))
    return counts


def _is_true(space: ParameterSpace, params: Params, name: str, wanted: Any) -> bool:
    parameter, value = space[name], params[name]
    if not space.is_active(name, params):
        return False
    if isinstance(parameter, Choice):
        return str(value) in ([wanted] if isinstance(wanted, str) else wanted)
    return (float(value) > (parameter.low + parameter.high) / 2) == (wanted == "high")


def _print(name: str, sentences: object, counts: np.ndarray) -> None:
    cells = [f"{true / asked:.0%} of {asked:.0f}" if asked else "" for kind in counts for asked, true in kind]
    row(name, sentences, cells[0], cells[1].split(" ")[0], cells[2], cells[3].split(" ")[0])


if __name__ == "__main__":
    main(*sys.argv[1:])
