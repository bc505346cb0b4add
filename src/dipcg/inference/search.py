"""Searching for the parameters of a picture by building and comparing: MCMC, random search and CMA-ES on one budget.

A point is `x`, followed by three numbers for the camera unless that is fixed, all in [-1, 1]. A score is a distance
between the picture and a render of the point, lower is better. Every searcher is a function of its seed and of the
scores so far, so a search that was killed continues from the log of its scores.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

from dipcg.camera import BOX_NUMBERS, View, view_from_box, view_to_box
from dipcg.generators import Generator
from dipcg.images import MARGIN
from dipcg.inference.evolution import EvolutionStrategy
from dipcg.mesh import Mesh
from dipcg.render import Renderer
from dipcg.space import Choice, ParameterSpace, Params
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError

Point = Float[np.ndarray, " n"]
Score = Callable[[UInt8[np.ndarray, "s s 4"]], float]
Propose = Callable[[Point], Point]
METHODS = ("mcmc", "random", "cma")


@runtime_checkable
class Searcher(Protocol):
    """Proposes points, and adapts to their scores."""

    def ask(self) -> list[Point]:
        """The next points."""
        ...

    def tell(self, points: list[Point], scores: list[float]) -> None:
        """The scores of these points."""
        ...


class Metropolis:
    """Chains of Metropolis-Hastings over points from given starts; all make one step at a time.

    Source: Metropolis et al. 1953, Hastings 1970. The density is exp(-score / temperature) on the box [-1, 1]^n; the
    proposal has to be symmetric.
    """

    def __init__(self, starts: list[Point], propose: Propose, temperature: float, rng: np.random.Generator) -> None:
        self.states, self.scores = list(starts), [math.inf] * len(starts)
        self.propose, self.temperature, self.rng = propose, temperature, rng
        self.accepted, self._started = 0, False

    def ask(self) -> list[Point]:
        return [self.propose(state) for state in self.states] if self._started else self.states

    def tell(self, points: list[Point], scores: list[float]) -> None:
        self._started = True
        for chain, (point, score) in enumerate(zip(points, scores, strict=True)):
            if self._accepts(self.scores[chain], score):
                self.states[chain], self.scores[chain] = point, score
                self.accepted += 1

    def _accepts(self, before: float, after: float) -> bool:
        threshold = math.log(self.rng.random())
        return bool(after <= before or threshold < (before - after) / self.temperature)


class RandomSearch:
    """Independent uniform points."""

    def __init__(self, draw: Callable[[], Point], batch: int) -> None:
        self.draw, self.batch = draw, batch

    def ask(self) -> list[Point]:
        return [self.draw() for _ in range(self.batch)]

    def tell(self, points: list[Point], scores: list[float]) -> None:
        pass


@dataclass(frozen=True)
class Moves:
    """The proposal: a few entries of a point move, reals by a normal step, choices to any option.

    It is symmetric: which entries move does not depend on their values, and a step beyond the box is reflected.
    Inactive parameters move too, so that they have random values when they become active.
    """

    space: ParameterSpace
    rng: np.random.Generator
    step: float = 0.2
    """standard deviation of a step of a real, in x"""
    share: float = 0.1
    """share of the entries that move; at least one does"""

    def __call__(self, point: Point) -> Point:
        moves = self.rng.random(len(point)) < self.share
        moves[self.rng.integers(len(point))] = True
        moved = reflect(point + self.step * self.rng.standard_normal(len(point)))
        for i in self.space.choices:
            moved[i] = self.rng.choice(_choice(self.space, i).centres)
        return np.where(moves, moved, point)


def reflect(point: Point) -> Point:
    """The point reflected at the borders of [-1, 1] until it lies inside, which leaves a proposal symmetric."""
    return np.abs((point - 1) % 4 - 2) - 1


class Objective:
    """The score of a point: it is built by a pool, rendered and compared. A failed build has an infinite score.

    With a `view` the camera is fixed, and points have no numbers for it.
    """

    def __init__(self, pool: BuildPool, score: Score, size: int, view: View | None = None) -> None:
        self.pool, self.score, self.view = pool, score, view
        self.generator: Generator = pool.generator
        self.renderer = Renderer(size)

    @property
    def dimension(self) -> int:
        return len(self.generator.space) + (BOX_NUMBERS if self.view is None else 0)

    def __call__(self, points: Sequence[Point]) -> Iterator[float]:
        meshes = self.pool.map([self.params(point) for point in points], "light")
        for point, mesh in zip(points, meshes, strict=True):
            yield math.inf if isinstance(mesh, BuildError) else self.score(self.render(mesh, point))

    def params(self, point: Point) -> Params:
        return self.generator.space.decode(point[: len(self.generator.space)])

    def camera(self, point: Point) -> View:
        """The fixed view, or the one of the point, which may stand behind the object."""
        return view_from_box(point[-BOX_NUMBERS:]) if self.view is None else self.view

    def point(self, params: Params, view: View) -> Point:
        """The point of parameters and a camera: the inverse of `params` and `camera`."""
        x = self.generator.space.encode(params)
        return x if self.view is not None else np.concatenate([x, view_to_box(view)])

    def render(self, mesh: Mesh, point: Point) -> UInt8[np.ndarray, "s s 4"]:
        return self.renderer.render(mesh, self.camera(point), margin=MARGIN)


@dataclass(frozen=True)
class Tried:
    """One call of the generator: its number from 1, its score, the best score so far and its point."""

    call: int
    score: float
    best: float
    best_point: Point


def search(
    searcher: Searcher, score: Callable[[Sequence[Point]], Iterator[float]], calls: int, past: Sequence[float] = ()
) -> Iterator[Tried]:
    """Let a searcher spend a budget of calls; scores in `past` are taken from there instead of being computed."""
    done, best, best_point = 0, math.inf, np.empty(0)
    while done < calls:
        points = searcher.ask()
        logged = list(past[done : done + len(points)])
        fresh = score(points[len(logged) :])
        scores: list[float] = []
        for number, point in enumerate(points):
            scores.append(logged[number] if number < len(logged) else next(fresh))
            if scores[-1] < best or not len(best_point):
                best, best_point = scores[-1], point
            done += 1
            yield Tried(done, scores[-1], best, best_point)
            if done == calls:
                return
        searcher.tell(points, scores)


def make_searcher(
    method: str, objective: Objective, rng: np.random.Generator, chains: int, temperature: float, start: Point | None
) -> Searcher:
    """MCMC, random search or CMA-ES by name, from a given point or from random ones; raises ValueError."""
    space, free = objective.generator.space, objective.dimension

    def draw() -> Point:
        return rng.uniform(-1, 1, free)

    if method == "random":
        return RandomSearch(draw, chains)
    if method == "cma":
        return EvolutionStrategy(draw() if start is None else start, 0.5 if start is None else 0.2, rng)
    if method == "mcmc":
        starts = [draw() if start is None else start for _ in range(chains)]
        return Metropolis(starts, Moves(space, rng), temperature, rng)
    raise ValueError(f"There is no method {method!r}. There are: {', '.join(METHODS)}.")


def _choice(space: ParameterSpace, index: int) -> Choice:
    parameter = space.parameters[index]
    assert isinstance(parameter, Choice), parameter
    return parameter
