"""Baselines without a network, for the tables of `evaluate.py`: the mean of the prior, and the nearest random shape."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from dipcg.data.store import Store
from dipcg.mesh import Mesh
from dipcg.metrics import Points, surface_points
from dipcg.metrics.chamfer import measure as chamfer
from dipcg.metrics.chamfer import quarter_turn
from dipcg.space import ParameterSpace, Params, Real
from dipcg.workers.pool import BuildPool

# Points by which most random shapes are ruled out.
FEW = 300
# The number of shapes that remain, to be compared by more points.
SHORTLIST = 8


class Shape(NamedTuple):
    """A random shape, with few of its surface points in the measuring frame."""

    params: Params
    mesh: Mesh
    points: Float[np.ndarray, "n 3"]


def middle(space: ParameterSpace) -> Params:
    """The mean of the prior: each real in the middle of its range, and each choice's first option.

    All options of a choice are drawn equally often, so the first is as likely as any other.
    """
    return space.canonical({p.name: p.decode(0.0) if isinstance(p, Real) else p.options[0] for p in space})


def stored_shapes(folder: str | Path, count: int) -> list[Shape]:
    """The first shapes of a data set's train split, without those that could not be built; raises ValueError."""
    built = ((sample.params, sample.mesh) for sample in Store(folder).samples("train") if sample.mesh)
    return _shapes(list(islice(built, count)))


def built_shapes(
    pool: BuildPool, count: int, seed: int = 0, report: Callable[[int], None] = lambda done: None
) -> list[Shape]:
    """Shapes of `count` random parameters, without those that cannot be built."""
    rng = np.random.default_rng(seed)
    drawn, made = [pool.generator.space.sample(rng) for _ in range(count)], []
    for done, built in enumerate(pool.timed(drawn, "light"), 1):
        if isinstance(built.mesh, Mesh):
            made.append((built.params, built.mesh))
        report(done)
    return _shapes(made)


def shortlist(shapes: Sequence[Shape], truth: Points, quarter_turns: bool = False) -> list[Shape]:
    """The few shapes that are nearest to the truth's surface points by few points, the nearest first.

    With `quarter_turns` each is compared at the best of four turns about Z.
    """
    # The truth is turned in place of the shapes; the distances are the same.
    few = truth[:FEW]
    turned = [quarter_turn(few, turns) for turns in range(4 if quarter_turns else 1)]
    distances = [min(chamfer(shape.points, target) for target in turned) for shape in shapes]
    return [shapes[i] for i in np.argsort(distances)[:SHORTLIST]]


def _shapes(built: list[tuple[Params, Mesh]]) -> list[Shape]:
    rng = np.random.default_rng(0)
    return [Shape(params, mesh, surface_points(mesh, FEW, rng)) for params, mesh in built]
