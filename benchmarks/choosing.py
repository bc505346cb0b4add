"""What ranking and searching on buy: chamfer distance of the estimate, the best ranked, the best of all, after builds.

On a test split (`DIPCG_BENCH_DATA`) or on pairs of picture and points (`DIPCG_BENCH_PAIRS`), with the checkpoint that
ships for `DIPCG_BENCH_GENERATOR`, chair when left out, or a folder. Searches are cut off by builds, since seconds
depend on what else the machine does; the seconds are printed beside them.
"""

import os
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.timing import header, machine, row
from dipcg.evaluation.evaluate import Case, distance, pair_cases, split_cases
from dipcg.inference.again import look_again
from dipcg.inference.rank import rank
from dipcg.inference.refine import Search
from dipcg.pipeline import Inverter

COUNT = int(os.environ.get("DIPCG_BENCH_SHAPES", "16"))
AFTER = (12, 24, 48)


@dataclass
class Rung:
    """One row of the table: distances of all cases, and the seconds that it took since the row above."""

    distances: list[float]
    seconds: list[float]


def main() -> None:
    data, pairs = os.environ.get("DIPCG_BENCH_DATA"), os.environ.get("DIPCG_BENCH_PAIRS")
    checkpoint = os.environ.get("DIPCG_BENCH_GENERATOR", "chair")
    if not data and not pairs:
        print("Skipped: set DIPCG_BENCH_DATA or DIPCG_BENCH_PAIRS to a folder.")
    with Inverter.load(checkpoint, workers=2) as inverter:
        if data:
            print(f"{machine()}, test split, {COUNT} shapes:\n")
            report(measure(inverter, split_cases(data, COUNT), False))
        if pairs:
            print(f"\n{machine()}, pairs, at the best of four quarter turns:\n")
            report(measure(inverter, list(pair_cases(pairs, Path(checkpoint).name))[:COUNT], True))


def measure(inverter: Inverter, cases: Iterable[Case], turned: bool) -> dict[str, Rung]:
    """The rungs of all cases."""
    rungs: dict[str, Rung] = {}
    for case in cases:
        for name, apart, seconds in climb(inverter, case, turned):
            rung = rungs.setdefault(name, Rung([], []))
            rung.distances.append(apart)
            rung.seconds.append(seconds)
    return rungs


def climb(inverter: Inverter, case: Case, turned: bool) -> Iterable[tuple[str, float, float]]:
    """Name, distance to the truth and seconds of each rung of one case."""
    started = time.perf_counter()
    estimate = inverter.estimate(case.image)
    yield "estimate", distance(inverter.pool.build(estimate.params, "light"), case, turned), _since(started)
    started = time.perf_counter()
    ranked = rank(estimate, inverter)
    taken = _since(started)
    apart = {id(c.params): distance(c.mesh, case, turned) for c in ranked.candidates}
    samples = [d for params, d in apart.items() if params != id(estimate.expected.params) and np.isfinite(d)]
    yield "one sample, the mean of all", float(np.mean(samples or list(apart.values()))), 0
    yield "best ranked", apart[id(ranked.params)], taken
    yield f"best of {len(estimate.candidates)} by truth", min(apart.values()), 0
    started = time.perf_counter()
    again = look_again(ranked, inverter)
    yield "looked again", distance(again.candidates[0].mesh, case, turned), _since(started)
    search = Search(ranked, inverter, time.monotonic(), 0)
    for builds in AFTER:
        started = time.perf_counter()
        while search.goes_on(np.inf, builds):
            search.generation()
        yield f"after {builds} builds of search", distance(search.best.mesh, case, turned), _since(started)
    search.close()


def report(rungs: dict[str, Rung]) -> None:
    """Mean distances with the gain over a sample and over the estimate."""
    against = [np.array(rungs[name].distances) for name in ("one sample, the mean of all", "estimate")]
    header("what", "chamfer", "less than a sample's by", "less than the estimate's by", "seconds")
    for name, rung in rungs.items():
        found = np.array(rung.distances)
        row(name, f"{found.mean():.4f}", *(gain(found, other) for other in against), f"{np.mean(rung.seconds):.1f}")


def gain(found: np.ndarray, other: np.ndarray) -> str:
    """By how much the mean is less, with a 95 % interval that is bootstrapped over cases in pairs."""
    picked = np.random.default_rng(0).integers(len(found), size=(2000, len(found)))
    low, high = np.percentile(1 - found[picked].mean(1) / other[picked].mean(1), [2.5, 97.5])
    return f"{100 * (1 - found.mean() / other.mean()):.0f} % [{100 * low:.0f}, {100 * high:.0f}]"


def _since(started: float) -> float:
    return time.perf_counter() - started


if __name__ == "__main__":
    main()
