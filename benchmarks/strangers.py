"""From a stranger's file to an answer: generators that nobody here wrote are added, learnt and used, each step timed.

DIPCG_BENCH_SOURCES is what `dipcg generators add` takes, parted by spaces; without it two factories of Infinigen, the
.scad file in examples/, and two files of PyTorchGeoNodes in the folder DIPCG_BENCH_BLENDS. DIPCG_BENCH_COUNT (3000) is
the number of shapes, DIPCG_BENCH_MINUTES (10) or DIPCG_BENCH_PICTURES the budget of training, DIPCG_BENCH_CASES (50)
the number of unseen shapes. DIPCG_BENCH_FOLDER (~/.cache/dipcg/strangers) keeps what is done: a stopped run continues.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.timing import header, machine, row
from dipcg.evaluation.tables import ESTIMATE
from dipcg.files import write_file
from dipcg.tracing.sites import snake

ROOT = Path(__file__).parents[1]
FOLDER = Path(os.environ.get("DIPCG_BENCH_FOLDER", "~/.cache/dipcg/strangers")).expanduser()
COUNT = os.environ.get("DIPCG_BENCH_COUNT", "3000")
CASES = os.environ.get("DIPCG_BENCH_CASES", "50")
PICTURES = os.environ.get("DIPCG_BENCH_PICTURES", "")
MINUTES = os.environ.get("DIPCG_BENCH_MINUTES", "10")
RANDOM = 200
# The last has the number of shapes behind it, which is less where the data set has fewer.
ROWS = (ESTIMATE, "mean of the prior", "nearest of")
STEPS = ("add", "shapes", "training", "evaluation", "asset")


def main() -> None:
    print(f"{machine()}, {COUNT} shapes, training for {PICTURES or MINUTES} {'pictures' if PICTURES else 'minutes'}\n")
    header(
        "generator",
        *(f"CD, {name} random" if name.endswith("of") else f"CD, {name}" for name in ROWS),
        *(f"{step}, s" for step in STEPS),
    )
    for source in sources():
        folder = FOLDER / name_of(source)
        folder.mkdir(parents=True, exist_ok=True)
        seconds = {step: done(folder, step, partial(run, folder, source, step)) for step in STEPS}
        table = json.loads((folder / "table.json").read_text())
        accuracy = [
            next(values for name, values in table.items() if name.startswith(one))["chamfer"][0] for one in ROWS
        ]
        row(name_of(source), *(f"{value:.3f}" for value in accuracy), *(f"{seconds[step]:.0f}" for step in STEPS))


def sources() -> list[str]:
    """What is added; the Blender files only where their folder is named."""
    given = os.environ.get("DIPCG_BENCH_SOURCES", "").split()
    blends = os.environ.get("DIPCG_BENCH_BLENDS")
    files = [str(Path(blends) / f"ptgn_{name}.blend") for name in ("chair", "table")] if blends else []
    own = ["infinigen:LampFactory", "infinigen:TableCocktailFactory", str(ROOT / "examples" / "fluted_vase.scad")]
    return given or [*files, *own]


def name_of(source: str) -> str:
    """A short name of a source, for its folder."""
    return snake(source.partition(":")[2] or Path(source).stem)


def done(folder: Path, step: str, work: Callable[[], None]) -> float:
    """The seconds that a step took; it is done only once."""
    file = folder / f"{step}.seconds"
    if not file.exists():
        started = time.monotonic()
        work()
        write_file(file, str(time.monotonic() - started))
    return float(file.read_text())


def run(folder: Path, source: str, step: str) -> None:
    """One step, as a person types it."""
    toml, data, trained = "generator.toml", "data", "run/generator"
    budget = f"--pictures {PICTURES}" if PICTURES else f"--minutes {MINUTES}"
    lines = {
        "add": [f"generators add {os.path.abspath(source) if Path(source).exists() else source} -o {toml}"],
        "shapes": [f"dataset build ./{toml} --count {COUNT} -o {data}"],
        "training": [f"train ./{toml} --data {data} {budget} -o run"],
        "evaluation": [
            f"evaluate {trained} --data {data} --count {CASES} --nearest-of {RANDOM} --json table.json {allow(toml)}"
        ],
        "asset": [
            f"evaluate {trained} --data {data} --count 1 --pictures pictures {allow(toml)}",
            f"estimate pictures -g {trained} -o assets/ {allow(toml)}",
        ],
    }
    for line in lines[step]:
        subprocess.run([sys.executable, "-m", "dipcg", *line.split()], cwd=folder, check=True, stdout=sys.stderr)


def allow(toml: str) -> str:
    """A checkpoint may not run a program by itself."""
    return f"--allow-code {toml}"


if __name__ == "__main__":
    main()
