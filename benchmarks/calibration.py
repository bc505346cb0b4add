"""Whether spreads and probabilities are right: ranks of the truth among samples, coverage, and reliability of choices.

Simulation-based calibration (Talts et al. 2018) on pictures of a split's unseen shapes (`DIPCG_BENCH_DATA`, a folder of
`dipcg dataset build`; `DIPCG_BENCH_SPLIT`, test when left out) with the checkpoint that ships for its generator or the
folder `DIPCG_BENCH_CHECKPOINT`. The figure is written to `DIPCG_BENCH_FIGURE`. With `DIPCG_BENCH_FIT=1` the calibration
scale of the samples is fitted on the validation split first, and written to the checkpoint's card.
"""

import json
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.drawing import save_figure
from benchmarks.timing import header, machine, row
from dipcg.data.store import Store
from dipcg.evaluation.evaluate import Case, split_cases
from dipcg.files import write_file
from dipcg.model.zoo import CARD, find_checkpoint
from dipcg.pipeline import Estimate, Inverter
from dipcg.space import ParameterSpace, Real

COUNT = int(os.environ.get("DIPCG_BENCH_PICTURES", "200"))
FIGURE = Path(os.environ.get("DIPCG_BENCH_FIGURE", "out/calibration.png"))
# Samples of each picture.
SAMPLES = 40
# Probability of each central interval.
LEVELS = (0.5, 0.8, 0.9)
BINS = 10
FACTORS = np.arange(1.0, 2.01, 0.05)


class Drawn(NamedTuple):
    """Of one active real, in x: its samples, their expectation, the truth, and a draw for its place among them."""

    values: np.ndarray
    centre: float
    truth: float
    place: float


@dataclass
class Found:
    """All active reals; for each active choice the probability of its likeliest option, and whether it is right."""

    reals: list[Drawn] = field(default_factory=list)
    probability: list[float] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)


def main() -> None:
    data = os.environ.get("DIPCG_BENCH_DATA")
    if not data:
        return print("Skipped: set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`.")
    checkpoint = os.environ.get("DIPCG_BENCH_CHECKPOINT") or Store(data).info["generator"]
    print(machine() + "\n")
    if os.environ.get("DIPCG_BENCH_FIT"):
        fit(checkpoint, data)
    found = measured(checkpoint, data, os.environ.get("DIPCG_BENCH_SPLIT", "test"))
    report(found)
    draw(found, FIGURE)
    print(f"\nFigure: {FIGURE}")


def measured(checkpoint: str, data: str, split: str, scale: float | None = None) -> Found:
    """Where the truth lies among the samples of all pictures; scaled as the card says unless a scale is given."""
    found, rng = Found(), np.random.default_rng(0)
    with Inverter.load(checkpoint) as inverter:
        config = inverter.model.config
        inverter.model.config = replace(config, calibration_scale=config.calibration_scale if scale is None else scale)
        for case in split_cases(data, COUNT, split=split):
            add(found, case, inverter.estimate(case.image, 1 + 2 * SAMPLES), inverter.generator.space, rng)
    return found


def fit(checkpoint: str, data: str) -> float:
    """Write the factor to the card with which coverage is nearest to right, on shapes that no table is about.

    Returns the share of true values that the widest interval of `LEVELS` then holds.
    """
    found, path = measured(checkpoint, data, "validation", 1.0), find_checkpoint(checkpoint) / CARD
    off = [sum(abs(coverage(found, level, factor) - level) for level in LEVELS) for factor in FACTORS]
    card, factor = json.loads(path.read_text()), float(FACTORS[np.argmin(off)])
    card["model"]["calibration_scale"] = round(factor, 2)
    write_file(path, json.dumps(card, indent=1))
    print(f"The calibration scale of the samples is {factor:.3g}.\n")
    return coverage(found, LEVELS[-1], factor)


def add(found: Found, case: Case, estimate: Estimate, space: ParameterSpace, rng: np.random.Generator) -> None:
    """Note where the truth lies for every parameter that it has active."""
    truth = case.params
    assert truth is not None
    # Up to half of the candidates assume an option, and are no samples.
    samples = [c.params for c in estimate.candidates[1:] if not c.assumed][:SAMPLES]
    drawn, active = (np.array([of(params) for params in samples]) for of in (space.encode, space.active))
    centre, right = space.encode(estimate.expected.params), space.encode(truth)
    for i in np.flatnonzero(space.active(truth)):
        parameter = space.parameters[i]
        if isinstance(parameter, Real):
            found.reals.append(Drawn(drawn[active[:, i], i], centre[i], right[i], rng.random()))
        else:
            probabilities = estimate.probabilities[parameter.name]
            likeliest = max(probabilities, key=probabilities.__getitem__)
            found.probability.append(probabilities[likeliest])
            found.right.append(likeliest == truth[parameter.name])


def below(found: Found, factor: float = 1.0) -> np.ndarray:
    """For each real the share of samples below the truth, when their distance from the expectation is scaled."""

    def share(one: Drawn) -> float:
        values = (one.centre + factor * (one.values - one.centre)).clip(-1, 1)
        # A place among the samples is one step wide.
        return ((values < one.truth).sum() + one.place) / (len(values) + 1)

    return np.array([share(one) for one in found.reals])


def coverage(found: Found, level: float, factor: float = 1.0) -> float:
    """The share of true values inside the central interval that should hold `level` of them."""
    return float((np.abs(below(found, factor) - 0.5) < level / 2).mean())


def reliability(found: Found) -> list[tuple[float, float, int]]:
    """Mean probability, share right and number of choices, in bins of equal width of the probability."""
    probability, right = np.array(found.probability), np.array(found.right)
    where = np.minimum((probability * BINS).astype(int), BINS - 1)
    inside = [where == number for number in range(BINS)]
    return [(float(probability[i].mean()), float(right[i].mean()), int(i.sum())) for i in inside if i.any()]


def calibration_error(found: Found) -> float:
    """The expected calibration error (Guo et al. 2017)."""
    bins = reliability(found)
    return sum(count * abs(mean - right) for mean, right, count in bins) / sum(count for _, _, count in bins)


def report(found: Found) -> None:
    header("what", "should be", "is")
    for level in LEVELS:
        row(f"active reals inside their {100 * level:.0f} % interval", f"{level:.2f}", f"{coverage(found, level):.3f}")
    # A flower has no choices.
    if found.probability:
        mean = np.mean(found.probability)
        row("probability of the likeliest option, mean", f"{np.mean(found.right):.3f}", f"{mean:.3f}")
        row("expected calibration error of choices", "0", f"{calibration_error(found):.3f}")
    print(f"\n{len(found.reals)} reals and {len(found.right)} choices of {COUNT} pictures, {SAMPLES} samples each.")


def draw(found: Found, path: Path) -> None:
    """Histogram of ranks, coverage against level, and reliability of choices, side by side."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    left.hist(below(found), 20, range=(0, 1), density=True, color="0.6")
    left.set(xlabel="share of samples below the truth", ylabel="density", title="ranks of the truth")
    levels = np.linspace(0, 1, 21)
    middle.plot(levels, [coverage(found, level) for level in levels], "k.-")
    middle.set(xlabel="central interval of the samples", ylabel="share of truths inside", title="coverage of reals")
    right.plot(*np.array(reliability(found)).reshape(-1, 3).T[:2], "k.-")
    right.set(xlabel="probability of the likeliest option", ylabel="share right", title="reliability of choices")
    left.axhline(1, color="tab:red")
    for axes in (middle, right):
        axes.plot([0, 1], [0, 1], color="tab:red")
    save_figure(figure, path, 80)


if __name__ == "__main__":
    main()
