"""One factor at a time: the recipe with a single flag changed, trained for the same minutes and measured alike.

Set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`. DIPCG_BENCH_MINUTES (3) of training for each,
DIPCG_BENCH_SHAPES (32) pictures of the test split, DIPCG_BENCH_PAIRS a folder of pairs to measure on besides,
DIPCG_BENCH_OUT (out/search) the checkpoints and what was measured; what is there already is not made again.
"""

import json
import os
from pathlib import Path

import numpy as np

from benchmarks.drawing import save_figure
from benchmarks.timing import header, machine, row
from benchmarks.trained import train
from dipcg.evaluation.evaluate import Case, distance, pair_cases, split_cases
from dipcg.evaluation.tables import bootstrap
from dipcg.files import write_file
from dipcg.metrics import load_metric
from dipcg.model.zoo import CARD
from dipcg.pipeline import Inverter

MINUTES = os.environ.get("DIPCG_BENCH_MINUTES", "3")
COUNT = int(os.environ.get("DIPCG_BENCH_SHAPES", "32"))
PAIRS = os.environ.get("DIPCG_BENCH_PAIRS")
OUT = Path(os.environ.get("DIPCG_BENCH_OUT", "out/search"))

WEAK = ("colour", "background", "crop", "hide", "blur", "noise", "jpeg", "lines", "mask", "edges", "flip")
PLAIN = tuple(word for name in WEAK for word in (f"--augment.{name}", "0"))
FIRST = "as it is"
RUNS: dict[str, tuple[str, ...]] = {
    FIRST: (),
    "the same, another seed": ("--seed", "1"),
    "batch 128": ("--batch", "128"),
    "pictures of 64²": ("--image-size", "64"),
    "pictures of 192²": ("--image-size", "192"),
    "one view": ("--augment.views", "0"),
    "no augmentation": PLAIN,
    "summary of 128": ("--summary", "128"),
    "denoiser in the last fifth": ("--denoiser-share", "0.2"),
    "pictures of one size": ("--no-grow",),
    "2 blocks": ("--depth", "2"),
    "1 draw a picture": ("--draws", "1"),
    "8 draws a picture": ("--draws", "8"),
    "no draws of pure noise": ("--pure-noise-fraction", "0"),
    "noise predicted (ddpm)": ("--objective", "ddpm", "--summary", "0", "--steps", "250"),
    "300 shapes": ("--shapes", "300"),
    "1,000 shapes": ("--shapes", "1000"),
}


def main() -> None:
    data = os.environ.get("DIPCG_BENCH_DATA")
    if not data:
        return print("Skipped: set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`.")
    print(f"{machine()}; {MINUTES} minutes of training for each run, {COUNT} pictures of the test split\n")
    header("run", "flags", "pictures", "million weights", "reals of the guess", "CD", "less than as it is by", "pairs")
    found: dict[str, dict] = {}
    for name, flags in chosen().items():
        found[name] = run(name, flags, data)
        row(name, _told(flags), *cells(found[name], next(iter(found.values()))["estimate"]))
    by_shapes = {one["shapes"]: one for name, one in found.items() if name == FIRST or "--shapes" in RUNS[name]}
    if len(by_shapes) > 1:
        draw(by_shapes, OUT / "shapes.png")


def chosen() -> dict[str, tuple[str, ...]]:
    """The runs that DIPCG_BENCH_RUNS names, with `;` between them, or all."""
    named = os.environ.get("DIPCG_BENCH_RUNS")
    return {name: RUNS[name] for name in named.split(";")} if named else RUNS


def run(name: str, flags: tuple[str, ...], data: str) -> dict:
    """Train and measure once, or read what was measured before."""
    folder = OUT / name.replace(" ", "-")
    if (folder / "found.json").is_file():
        return json.loads((folder / "found.json").read_text())
    checkpoint = train(data, folder, "--minutes", MINUTES, *flags)
    card = json.loads((checkpoint / CARD).read_text())
    with Inverter.load(str(checkpoint), workers=2) as inverter:
        found = measured(inverter, data) | {key: card[key] for key in ("pictures", "shapes", "validation")}
    write_file(folder / "found.json", json.dumps(found))
    return found


def measured(inverter: Inverter, data: str) -> dict:
    """Chamfer distances of the estimates, and the size of the network."""
    return {
        "estimate": apart(inverter, list(split_cases(data, COUNT)), False),
        "pairs": apart(inverter, list(pair_cases(PAIRS, inverter.generator.name)), True) if PAIRS else [],
        "weights": sum(weight.numel() for weight in inverter.model.parameters()),
    }


def apart(inverter: Inverter, cases: list[Case], turned: bool) -> list[float]:
    """The chamfer distance of each case, 2,500 points a shape; the worst where nothing can be built."""
    built = inverter.pool.map((inverter.estimate(case.image, 1).params for case in cases), "light")
    meshes = [None if isinstance(mesh, Exception) else mesh for mesh in built]
    worst = load_metric("chamfer").worst
    return [min(worst, distance(mesh, case, turned)) for mesh, case in zip(meshes, cases, strict=True)]


def cells(found: dict, first: list[float]) -> tuple[str, ...]:
    """What a row of the table says of one run."""
    own, check = np.array(found["estimate"]), found["validation"]
    more = np.array(first) - own
    low, high = bootstrap(more)
    guess = f"{check['guess_reals']:.3f}" if check["guess_reals"] else ""
    return (
        f"{found['pictures']:,}",
        f"{found['weights'] / 1e6:.1f}",
        guess,
        f"{own.mean():.3f}",
        f"{more.mean():.3f} [{low:.3f}, {high:.3f}]" if more.any() else "",
        f"{np.mean(found['pairs']):.3f}" if found["pairs"] else "",
    )


def draw(by_shapes: dict[int, dict], path: Path) -> None:
    """CD of test pictures and of pairs over the number of shapes trained on, this logarithmic."""
    from matplotlib.figure import Figure

    figure = Figure((5, 3.2), layout="constrained")
    axes, counts = figure.subplots(), sorted(by_shapes)
    for key, label in (("estimate", "test split"), ("pairs", "pairs")):
        values = [np.array(by_shapes[count][key]) for count in counts]
        if all(len(some) for some in values):
            low, high = np.array([bootstrap(some) for some in values]).T
            means = np.array([some.mean() for some in values])
            axes.errorbar(counts, means, (means - low, high - means), fmt="o-", capsize=3, label=label)
    axes.set(xscale="log", ylim=(0, None), xlabel="shapes trained on", ylabel="CD")
    axes.set_xticks(counts, [f"{count:,}" for count in counts])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend()
    save_figure(figure, path, 110)


def _told(flags: tuple[str, ...]) -> str:
    return "`--augment.NAME 0` of all but views" if flags == PLAIN else f"`{' '.join(flags)}`" if flags else ""


if __name__ == "__main__":
    main()
