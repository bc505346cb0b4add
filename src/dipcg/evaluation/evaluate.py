"""Measuring estimates against shapes: the protocol of every table in docs/results.md.

Each mesh is centred on its bounding box and scaled to longest side 1; each metric says in its file how many points it
takes and what a failed build counts as. A failed build counts as the worst case and is never skipped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dipcg import registry
from dipcg.camera import View
from dipcg.data.codec import decode_mesh
from dipcg.data.shapes import load_shapes
from dipcg.evaluation.baselines import Shape, middle, shortlist
from dipcg.evaluation.reader import perfect_reading
from dipcg.evaluation.tables import ESTIMATE, Table
from dipcg.images import MARGIN, Source
from dipcg.inference.again import look_again
from dipcg.inference.rank import rank
from dipcg.inference.refine import refine
from dipcg.mesh import Mesh
from dipcg.metrics import Metric, load_metric, normalise, surface_points
from dipcg.metrics.chamfer import best_quarter_turn
from dipcg.metrics.chamfer import measure as chamfer
from dipcg.pipeline import Estimate, Inverter
from dipcg.render import Renderer, sample_look
from dipcg.space import Params
from dipcg.workers.process import BuildError

# Side of the pictures that are made of a test split.
PICTURE = 256
# Points by which the candidate nearest to the truth is found.
CHOSEN_BY = 2500
# The metrics of a table when none is named. EMD takes seconds for each shape.
USUAL_METRICS = ("chamfer", "fscore", "choice_accuracy")
Sampler = Callable[[int, np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Case:
    """A picture and the shape it shows; `sample(count, rng)` gives points of the surface in the measuring frame.

    Pictures of data sets also have the true parameters, mesh and camera.
    """

    name: str
    image: Source
    sample: Sampler
    params: Params | None = None
    mesh: Mesh | None = None
    view: View | None = None


def split_cases(folder: str | Path, count: int, seed: int = 0, split: str = "test") -> Iterator[Case]:
    """Pictures of a data set's unseen shapes from random training views with random materials, on no background."""
    generator, shapes = load_shapes(folder, split)
    renderer, rng = Renderer(PICTURE), np.random.default_rng(seed)
    for number in range(min(count, len(shapes.meshes))):
        mesh = decode_mesh(shapes.meshes[number])
        look = sample_look(rng, len(mesh.part_names))
        params = generator.space.decode(shapes.x[number].astype(float))
        view = generator.seen_from(params).sample(rng)
        image = np.ascontiguousarray(renderer.render(mesh, view, look, MARGIN))
        yield Case(f"{split}-{number}", image, mesh_sampler(mesh), params, mesh, view)


def pair_cases(folder: str | Path, prefix: str) -> Iterator[Case]:
    """Pictures `NAME.png` with surface points `NAME.npz` (array `points`, `n 3`, Z up) whose names have this prefix.

    Raises ValueError when the folder has none.
    """
    pictures = [path for path in sorted(Path(folder).glob(f"{prefix}*.png")) if path.with_suffix(".npz").is_file()]
    if not pictures:
        raise ValueError(f"{folder} has no pair {prefix}*.png and {prefix}*.npz (with an array `points`).")
    return map(_pair, pictures)


def _pair(path: Path) -> Case:
    points = normalise(np.load(path.with_suffix(".npz"))["points"].astype(float))
    return Case(path.stem, path, lambda count, rng: rng.choice(points, count, count > len(points)))


class Shown(NamedTuple):
    """The parameters that a row of the table has for a picture, and their mesh; None when it cannot be built."""

    row: str
    params: Params
    mesh: Mesh | None


@dataclass(frozen=True)
class Plan:
    """What is measured of each picture, and how; the rows of the table follow from it."""

    candidates: int = 16
    """candidates of each estimate, the expected one among them"""
    steps: int | None = None
    """steps of the sampler; as many as the checkpoint was made for when None"""
    quarter_turns: bool = False
    """compare at the best of four turns about Z, for data with unknown fronts"""
    metrics: Sequence[str] = ()
    """names of metrics, or "all"; CD, F at 0.02 and the choices that are right when empty"""
    ranked: bool = False
    """build all candidates, and measure the one that ranking puts first and the one nearest to the truth too"""
    refine_s: float = 0.0
    """seconds of search after which the result is measured too; none when 0"""
    perfect: bool = False
    """measure what a reader would estimate who makes no mistake about what the picture shows"""
    random_shapes: Sequence[Shape] = ()
    """shapes of which the one nearest to the truth is a row: the bound of a search without a network"""


def columns(names: Sequence[str]) -> list[Metric]:
    """The columns of a table: those of the named metrics with their variants, of "all", or the usual three."""
    if not names:
        return [load_metric(name).columns[0] for name in USUAL_METRICS]
    every = registry.names("metrics") if list(names) == ["all"] else names
    return [column for name in every for column in load_metric(name).columns]


def evaluate(
    inverter: Inverter,
    cases: Iterable[Case],
    plan: Plan = Plan(),
    report: Callable[[Case], None] = lambda case: None,
) -> Table:
    """A table of estimates beside their bounds.

    The rows: the noise floor (other points of the truth); a random shape; the mean of the prior, which is the same for
    every picture; the nearest of some random shapes; the direct guess; the most central sample; and the estimate.
    """
    table = Table(columns(plan.metrics))
    mean = _built(inverter, "mean of the prior", middle(inverter.generator.space))
    for number, case in enumerate(cases):
        if case.mesh is not None:
            table.add("noise floor", _compare(table.metrics, case, case.mesh, None, number, False, inverter))
        for row, params, mesh in [_random(inverter, number), mean, *_estimates(inverter, case, plan)]:
            values = _compare(table.metrics, case, mesh, params, number, plan.quarter_turns, inverter)
            table.add(row, values, failed=mesh is None)
        report(case)
    return table


def _estimates(inverter: Inverter, case: Case, plan: Plan) -> Iterator[Shown]:
    """The rows that depend on the picture."""
    estimate = inverter.estimate(case.image, max(2, plan.candidates), plan.steps)
    yield from _nearest(plan.random_shapes, case, plan.quarter_turns)
    yield from _unranked(inverter, estimate, case)
    if plan.perfect and case.params is not None and case.view is not None:
        read = perfect_reading(inverter, case.params, case.view, estimate.params)
        yield _built(inverter, "perfect reader", case.params if read is None else read)
    if plan.ranked or plan.refine_s:
        yield from _ranked(inverter, estimate, case, plan)


def _random(inverter: Inverter, number: int) -> Shown:
    rng = np.random.default_rng([1, number])
    return _built(inverter, "prior (a random one)", inverter.generator.space.sample(rng))


def _nearest(shapes: Sequence[Shape], case: Case, quarter_turns: bool) -> Iterator[Shown]:
    if shapes:
        few = shortlist(shapes, case.sample(CHOSEN_BY, np.random.default_rng(0)), quarter_turns)
        nearest = min(few, key=lambda shape: distance(shape.mesh, case, quarter_turns))
        yield Shown(f"nearest of {len(shapes)} random", nearest.params, nearest.mesh)


def _unranked(inverter: Inverter, estimate: Estimate, case: Case) -> Iterator[Shown]:
    if inverter.model.makes_guess:
        yield _built(inverter, "direct guess", inverter.guess(case.image).params)
    yield _built(inverter, "most central sample", estimate.candidates[1].params)
    yield _built(inverter, ESTIMATE, estimate.params)


def _ranked(inverter: Inverter, estimate: Estimate, case: Case, plan: Plan) -> Iterator[Shown]:
    ranked = rank(estimate, inverter)
    yield Shown("best ranked", ranked.params, ranked.candidates[0].mesh)
    again = look_again(ranked, inverter)
    yield Shown("looked again", again.params, again.candidates[0].mesh)
    nearest = min(ranked.candidates, key=lambda candidate: distance(candidate.mesh, case, plan.quarter_turns))
    yield Shown(f"best of {len(estimate.candidates)} by truth", nearest.params, nearest.mesh)
    if plan.refine_s:
        refined = refine(ranked, inverter, plan.refine_s)
        yield Shown(f"refined for {plan.refine_s:g} s", refined.params, refined.candidates[0].mesh)


def distance(mesh: Mesh | None, case: Case, quarter_turns: bool) -> float:
    """The chamfer distance by fewer points than in the table, which are enough to choose by."""
    if mesh is None:
        return np.inf
    rng = np.random.default_rng(0)
    ours, truth = surface_points(mesh, CHOSEN_BY, rng), case.sample(CHOSEN_BY, rng)
    return chamfer(best_quarter_turn(ours, truth) if quarter_turns else ours, truth)


def _built(inverter: Inverter, row: str, params: Params) -> Shown:
    try:
        return Shown(row, params, inverter.build(params, "light").mesh)
    except BuildError:
        return Shown(row, params, None)


def _compare(
    metrics: list[Metric],
    case: Case,
    mesh: Mesh | None,
    params: Params | None,
    number: int,
    quarter_turns: bool,
    inverter: Inverter,
) -> dict[str, float]:
    values: dict[str, float] = {}
    # The truth has the same points in every row, whichever rows there are.
    rng = np.random.default_rng([1, number])
    for count in sorted({metric.points for metric in metrics if metric.compares == "points"}):
        truth, ours = case.sample(count, rng), None if mesh is None else surface_points(mesh, count, rng)
        if ours is not None and quarter_turns:
            ours = best_quarter_turn(ours, truth)
        for metric in metrics:
            if metric.compares == "points" and metric.points == count:
                values[metric.name] = metric.worst if ours is None else metric.measure(ours, truth)
    if case.params is not None and params is not None:
        for metric in metrics:
            if metric.compares == "params":
                value = metric.measure(inverter.generator.space, case.params, params)
                # A flower has no choices, and so no accuracy of choices.
                values |= {} if np.isnan(value) else {metric.name: value}
    return values


def mesh_sampler(mesh: Mesh) -> Sampler:
    """A sampler of points `n 3` of the mesh's surface in the measuring frame."""
    return lambda count, rng: surface_points(mesh, count, rng)
