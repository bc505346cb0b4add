"""Every way to get from a picture to a chair, on the same pictures, in one run: quality, calls of the generator, time.

Set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`. DIPCG_BENCH_SHAPES (50) pictures of its test split,
DIPCG_BENCH_CALLS (1000) calls of the generator for each search, DIPCG_BENCH_CHECKPOINT (chair), DIPCG_BENCH_OUT (out)
for the plot and the numbers, DIPCG_BENCH_METHODS (all) names of methods with `;` between them, DIPCG_BENCH_MESHES a
list NAME=FOLDER of what other tools made of the same pictures (`dipcg evaluate --pictures` writes them).
"""

import json
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.drawing import save_figure
from benchmarks.memory import PeakMemory
from benchmarks.timing import header, machine, row
from dipcg.evaluation.evaluate import Case, split_cases
from dipcg.evaluation.external import find_mesh, measured, read_mesh
from dipcg.evaluation.retrieval import Neighbours
from dipcg.files import write_file
from dipcg.images import prepare
from dipcg.inference.compare import SIDE, Picture
from dipcg.inference.rank import rank
from dipcg.inference.search import Objective, Point, make_searcher, search
from dipcg.inference.trace import marks
from dipcg.mesh import Mesh
from dipcg.metrics import load_metric, surface_points
from dipcg.pipeline import Inverter
from dipcg.space import Params
from dipcg.workers.process import BuildError

COUNT = int(os.environ.get("DIPCG_BENCH_SHAPES", "50"))
CALLS = int(os.environ.get("DIPCG_BENCH_CALLS", "1000"))
CHECKPOINT = os.environ.get("DIPCG_BENCH_CHECKPOINT", "chair")
OUT = Path(os.environ.get("DIPCG_BENCH_OUT", "out"))
METRICS = [load_metric(name) for name in ("chamfer", "emd", "fscore")]
METHODS = [name for name in os.environ.get("DIPCG_BENCH_METHODS", "").split(";") if name]
CHAINS = 4

# The row of the table, the parameters, the calls of the generator and the seconds until then.
Answer = tuple[str, Params, int, float]
Method = Callable[[Case], Iterator[Answer]]


@dataclass
class Row:
    """What one method did over all pictures."""

    values: dict[str, list[float]] = field(default_factory=dict)
    calls: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    megabytes: float = 0.0
    failed: int = 0


def main() -> None:
    data = os.environ.get("DIPCG_BENCH_DATA")
    if not data:
        print("Skipped: set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`.")
        return
    rows: dict[str, Row] = {}
    with Inverter.load(CHECKPOINT, workers=2) as inverter:
        began = time.perf_counter()
        neighbours = Neighbours(inverter, data, 500)
        print(f"{machine()}; {COUNT} pictures; {time.perf_counter() - began:.0f} s to render the neighbours\n")
        inverter.pool.warm()
        for number, case in enumerate(split_cases(data, COUNT)):
            for method in _methods(inverter, neighbours, number):
                with PeakMemory() as memory:
                    answers = list(method(case))
                for name, params, calls, seconds in answers:
                    _add(rows.setdefault(name, Row()), case, _build(inverter, params), number, calls, seconds, memory)
            for name, folder in _others():
                path = find_mesh(folder, case.name)
                values = measured(METRICS, case, read_mesh(path) if path else None, np.random.default_rng([1, number]))
                _keep(rows.setdefault(name, Row()), values, failed=path is None)
    _tell(rows)


def _methods(inverter: Inverter, neighbours: Neighbours, number: int) -> list[Method]:
    """The methods; each gives what it found with the calls and the seconds it took, searches at several moments."""

    def once(name: str, find: Callable[[Case], Params], calls: int) -> tuple[str, Method]:
        def work(case: Case) -> Iterator[Answer]:
            began = time.perf_counter()
            yield name, find(case), calls, time.perf_counter() - began

        return name, work

    def searching(name: str, method: str, estimated: bool) -> tuple[str, Method]:
        def work(case: Case) -> Iterator[Answer]:
            began, rng = time.perf_counter(), np.random.default_rng(number)
            objective = _objective(inverter, case)
            start = _start(inverter, objective, case) if estimated else None
            searcher = make_searcher(method, objective, rng, CHAINS, 0.01, start)
            for tried in search(searcher, objective, CALLS):
                if tried.call in marks(CALLS):
                    found = objective.params(tried.best_point)
                    yield f"{name}, {tried.call:,} calls", found, tried.call, time.perf_counter() - began
            objective.renderer.close()

        return name, work

    every = [
        once("a random one", lambda case: inverter.generator.space.sample(np.random.default_rng(number)), 0),
        once(f"nearest neighbour of {neighbours.count}", lambda case: neighbours.find(case.image).params, 0),
        once("direct regression", lambda case: inverter.guess(case.image).params, 0),
        once("estimate, 1 candidate", lambda case: inverter.estimate(case.image, 1).params, 0),
        once("16 candidates, ranked", lambda case: rank(inverter.estimate(case.image, 16), inverter).params, 16),
        searching("random search", "random", False),
        searching("CMA-ES", "cma", False),
        searching("MCMC", "mcmc", False),
        searching("MCMC from the estimate", "mcmc", True),
    ]
    return [work for name, work in every if not METHODS or name in METHODS]


def _objective(inverter: Inverter, case: Case) -> Objective:
    picture = Picture(*prepare(case.image, SIDE))
    return Objective(inverter.pool, lambda render: 1 - picture.match(render).agreement, SIDE)


def _start(inverter: Inverter, objective: Objective, case: Case) -> Point:
    found = inverter.estimate(case.image, 1)
    return objective.point(found.params, found.view)


def _others() -> list[tuple[str, Path]]:
    given = os.environ.get("DIPCG_BENCH_MESHES", "").split()
    return [(name, Path(folder)) for name, folder in (word.split("=", 1) for word in given)]


def _build(inverter: Inverter, params: Params) -> Mesh | None:
    try:
        return inverter.build(params, "light").mesh
    except BuildError:
        return None


def _add(row: Row, case: Case, mesh: Mesh | None, number: int, calls: int, seconds: float, memory: PeakMemory) -> None:
    """Our own meshes are measured where they are: no alignment."""
    rng, values = np.random.default_rng([1, number]), {}
    for metric in METRICS:
        truth = case.sample(metric.points, rng)
        ours = None if mesh is None else surface_points(mesh, metric.points, rng)
        values[metric.name] = metric.worst if ours is None else metric.measure(ours, truth)
    row.calls.append(calls)
    row.seconds.append(seconds)
    row.megabytes = max(row.megabytes, memory.megabytes)
    _keep(row, values, failed=mesh is None)


def _keep(row: Row, values: dict[str, float], failed: bool) -> None:
    for name, value in values.items():
        row.values.setdefault(name, []).append(value)
    row.failed += failed


def _tell(rows: dict[str, Row]) -> None:
    names = [metric.name for metric in METRICS]
    header("method", *names, "calls of the generator", "median s", "peak MB", "failed")
    for name, found in rows.items():
        cells = [_interval(found.values[metric]) for metric in names]
        spent = [f"{np.median(found.calls):.0f}", f"{np.median(found.seconds):.2f}"] if found.calls else ["", ""]
        row(name, *cells, *spent, f"{found.megabytes:.0f}" if found.calls else "", found.failed)
    OUT.mkdir(parents=True, exist_ok=True)
    write_file(OUT / "versus.json", json.dumps({name: vars(found) for name, found in rows.items()}, indent=1))
    plot(rows, OUT / "versus.png")


def _interval(values: list[float]) -> str:
    drawn = np.random.default_rng(0).choice(values, (2000, len(values))).mean(1)
    return f"{np.mean(values):.3f} [{np.percentile(drawn, 2.5):.3f}, {np.percentile(drawn, 97.5):.3f}]"


def plot(rows: dict[str, Row], path: Path) -> None:
    """CD over seconds, these logarithmic; the moments of one search are joined."""
    from matplotlib.figure import Figure

    figure = Figure((8, 4.5), layout="constrained")
    axes = figure.subplots()
    lines: dict[str, list[tuple[float, float]]] = {}
    for name, found in rows.items():
        if found.seconds:
            method = name.partition(", ")[0] if name.endswith("calls") else name
            lines.setdefault(method, []).append(
                (float(np.median(found.seconds)), float(np.mean(found.values["chamfer"])))
            )
    for name, points in lines.items():
        axes.plot(*zip(*points, strict=True), "o-", label=name)
    axes.set(xscale="log", ylim=(0, None), xlabel="seconds a picture", ylabel="CD")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    save_figure(figure, path, 110)


if __name__ == "__main__":
    main()
