"""Choosing among candidates: each is rendered from its own estimated camera and compared with the picture.

Agreement alone does not choose well: with a camera that may move, a wrong shape can look right. So the agreements give
each candidate a weight, and the first is the one with the least weighted distance to all others: the least expected
distance from the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from scipy.spatial import KDTree

from dipcg.camera import FARTHEST, MAX_ELEVATION_DEG, NEAREST, View
from dipcg.images import MARGIN
from dipcg.inference.compare import SIDE, Picture
from dipcg.mesh import Mesh
from dipcg.metrics import surface_points
from dipcg.model.alternatives import shares
from dipcg.pipeline import Candidate, Estimate, Inverter
from dipcg.render import Renderer
from dipcg.space import Choice, ParameterSpace, Params
from dipcg.workers.process import BuildError

# Mean difference of active reals in x below which two candidates with the same choices count as one.
SAME = 0.03
# Renders in the search for a candidate's camera: without it a good candidate a few degrees off would look bad.
FEW_RENDERS = 10
# Renders in the longer search for the camera of the first.
MANY_RENDERS = 24
# Steps of that search: azimuth and elevation in degrees, distance as a logarithm.
STEPS = np.array([8.0, 6.0, 0.2])
# Weight of the surprise against the agreement.
SURPRISE_WEIGHT = 0.1
# Weight of the squared distance of the camera from the expected one, in steps, and the most that this counts.
CAMERA_WEIGHT, CAMERA_LIMIT = 0.01, 9.0
# Of the score: the difference that makes one candidate e times as likely as another.
TEMPERATURE = 0.07
# Points of a surface from which the distance of two candidates is measured.
POINTS = 512


def rank(estimate: Estimate, inverter: Inverter, report: Callable[[int], None] = lambda built: None) -> Estimate:
    """Build the light mesh of every candidate, and order them by their expected distance from the truth.

    Candidates that are nearly the same are merged; one that cannot be built goes last. `report` is called with the
    number of candidates that are built. The misfit is 1 minus the highest agreement.
    """
    meshes = light_meshes(inverter, [candidate.params for candidate in estimate.candidates])
    return order(estimate, meshes, inverter.generator.space, report)


def order(
    estimate: Estimate,
    meshes: Iterable[Mesh | BuildError],
    space: ParameterSpace,
    report: Callable[[int], None] = lambda built: None,
) -> Estimate:
    """As `rank`, with light meshes from elsewhere, one for each candidate, or the error in its place.

    A candidate that has its agreement is not compared with the picture again.
    """
    judge, seen = Judge(estimate, space), []
    try:
        for number, (candidate, mesh) in enumerate(zip(estimate.candidates, meshes, strict=True), 1):
            seen.append(compared(judge, candidate, mesh))
            report(number)
        first, *others = judge.safest_first(judge.best_first(seen))
        ordered = [judge.align(first), *others]
    finally:
        judge.close()
    return with_candidates(estimate, merge(ordered, space))


def compared(judge: Judge, candidate: Candidate, mesh: Mesh | BuildError, *others: View) -> Candidate:
    """The candidate with its mesh and its agreement, from the best camera near its own, the expected one, or others."""
    if isinstance(mesh, BuildError) or candidate.agreement is not None:
        return candidate
    return judge.align(judge.look(replace(candidate, mesh=mesh), *others), FEW_RENDERS)


def light_meshes(inverter: Inverter, many: Iterable[Params]) -> Iterator[Mesh | BuildError]:
    """The light meshes of several parameter sets, in order; the error of a failed one stands in its place.

    A build whose worker died is tried once more, since the cause may lie outside of it.
    """
    for built in inverter.pool.timed(many, "light"):
        crashed = isinstance(built.mesh, BuildError) and built.mesh.reason == "crashed"
        yield next(inverter.pool.map([built.params])) if crashed else built.mesh


def turned(view: View, azimuth_deg: float, elevation_deg: float, nearer: float) -> View:
    """The camera moved by two angles and by a factor exp(-nearer) of its distance, within the range of the network."""
    elevation = min(max(view.elevation_deg + elevation_deg, -MAX_ELEVATION_DEG), MAX_ELEVATION_DEG)
    distance = min(max(view.distance * float(np.exp(-nearer)), NEAREST), FARTHEST)
    return replace(
        view,
        azimuth_deg=(view.azimuth_deg + azimuth_deg + 180) % 360 - 180,
        elevation_deg=elevation,
        distance=distance,
    )


def with_candidates(estimate: Estimate, candidates: list[Candidate]) -> Estimate:
    """The estimate with these candidates, and the misfit of the one that agrees best."""
    agreements = [candidate.agreement for candidate in candidates if candidate.agreement is not None]
    return replace(estimate, candidates=candidates, misfit=1 - max(agreements) if agreements else None)


class Judge:
    """Scores built candidates by their agreement with the picture and by what the network expects."""

    def __init__(self, estimate: Estimate, space: ParameterSpace) -> None:
        if estimate.background == "words":
            raise ValueError("An estimate from words has no picture to be compared with.")
        self.estimate, self.space = estimate, space
        self.picture = Picture(estimate.image, estimate.background)
        # Without multisampling, since silhouettes are blurred anyway; this takes half the time.
        self.renderer = Renderer(SIDE, samples=0)
        self._expected = space.encode(estimate.expected.params)

    def close(self) -> None:
        """Free the renderer."""
        self.renderer.close()

    def agreement(self, mesh: Mesh, view: View) -> float:
        """How well the mesh seen from a camera matches the picture, from 0 to 1."""
        return self.picture.match(self.renderer.render(mesh, view, margin=MARGIN)).agreement

    def look(self, candidate: Candidate, *others: View) -> Candidate:
        """The built candidate with its agreement, from its own camera or the best of the expected one and others."""
        assert candidate.mesh is not None
        views = [candidate.view, self.estimate.expected.view, *others]
        best, number = max((self.agreement(candidate.mesh, view), number) for number, view in enumerate(views))
        return replace(candidate, agreement=best, view=views[number])

    def align(self, candidate: Candidate, renders: int = MANY_RENDERS) -> Candidate:
        """The same candidate with the camera near its own that agrees best (Nelder & Mead 1965)."""
        mesh, view = candidate.mesh, candidate.view
        if mesh is None or candidate.agreement is None:
            return candidate
        corners = np.vstack([np.zeros(3), np.eye(3)])
        done = minimize(
            lambda step: -self.agreement(mesh, turned(view, *(step * STEPS))),
            np.zeros(3),
            method="Nelder-Mead",
            options={"maxfev": renders, "initial_simplex": corners, "xatol": 1e-2, "fatol": 1e-4},
        )
        if -done.fun <= candidate.agreement:
            return candidate
        return replace(candidate, agreement=float(-done.fun), view=turned(view, *(done.x * STEPS)))

    def score(self, candidate: Candidate) -> float:
        """The agreement minus the price of parameters and a camera that the network did not expect."""
        if candidate.agreement is None:
            return -np.inf
        moved = min(squared_steps(candidate.view, self.estimate.expected.view), CAMERA_LIMIT)
        return candidate.agreement - SURPRISE_WEIGHT * self.surprise(candidate.params) - CAMERA_WEIGHT * moved

    def surprise(self, params: Params) -> float:
        """Mean over active parameters: distance in x from the expected candidate, and 1 - probability of choices."""
        active, x = self.space.active(params), self.space.encode(params)
        distance = np.abs(x - self._expected)
        for i in self.space.choices:
            name = self.space.names[i]
            distance[i] = 1 - self.estimate.probabilities[name][params[name]]
        return float(distance[active].mean()) if active.any() else 0.0

    def best_first(self, candidates: list[Candidate]) -> list[Candidate]:
        """Ordered by score; those that could not be built last."""
        return sorted(candidates, key=self.score, reverse=True)

    def safest_first(self, candidates: list[Candidate]) -> list[Candidate]:
        """Ordered by the expected distance from the truth.

        The probability that each is the truth follows from its score and from the probability of its options, which it
        shares with the candidates that have the same: rare options have more candidates than their probability says.
        """
        built = [candidate for candidate in candidates if candidate.mesh is not None]
        if not built:
            return candidates
        scores = np.array([self.score(candidate) for candidate in built])
        prior = shares(self.space, [candidate.params for candidate in built], self.estimate.probabilities)
        weights = np.exp((scores - scores.max()) / TEMPERATURE) * prior
        expected = distances([c.mesh for c in built if c.mesh is not None]) @ weights
        return [built[i] for i in np.argsort(expected, kind="stable")] + [c for c in candidates if c.mesh is None]


def squared_steps(view: View, other: View) -> float:
    """The squared distance of two cameras, in units of `STEPS`."""
    azimuth = (view.azimuth_deg - other.azimuth_deg + 180) % 360 - 180
    nearness = np.log(view.distance / other.distance)
    return float((([azimuth, view.elevation_deg - other.elevation_deg, nearness] / STEPS) ** 2).sum())


def distances(meshes: list[Mesh]) -> Float[np.ndarray, "n n"]:
    """Chamfer distance of every two meshes, from few points."""
    points = [surface_points(mesh, POINTS, np.random.default_rng(0)) for mesh in meshes]
    trees = [KDTree(p) for p in points]
    one_way = np.array([[tree.query(p)[0].mean() for tree in trees] for p in points])
    return (one_way + one_way.T) / 2


def merge(candidates: list[Candidate], space: ParameterSpace) -> list[Candidate]:
    """The candidates without those that are nearly the same as an earlier one; the unbuilt ones stay."""
    different: list[Candidate] = []
    for candidate in candidates:
        if candidate.mesh is None or not any(_same(space, candidate, other) for other in different):
            different.append(candidate)
    return different


def _same(space: ParameterSpace, a: Candidate, b: Candidate) -> bool:
    if b.mesh is None or any(isinstance(p, Choice) and a.params[p.name] != b.params[p.name] for p in space):
        return False
    reals = space.active(a.params)
    reals[space.choices] = False
    difference = np.abs(space.encode(a.params) - space.encode(b.params))[reals]
    return not len(difference) or float(difference.mean()) < SAME
