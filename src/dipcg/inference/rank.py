"""Choosing among candidates: render each from its own estimated camera and compare with the picture.

Agreement alone is a bad judge: with a camera that may move, a wrong shape can look right. So it weighs candidates, and
the one is chosen that is nearest to all others by their weight: the least expected distance from the truth.
"""

from __future__ import annotations

from collections.abc import Callable
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
from dipcg.pipeline import Candidate, Estimate
from dipcg.render import Renderer
from dipcg.space import Choice, Params
from dipcg.workers.process import BuildError

SAME = 0.03  # mean difference of active reals in x, below which two candidates with the same choices are one
GLANCES = 10  # renders in the search for a candidate's camera: without it a good one a few degrees off looks bad
STEPS = np.array([8.0, 6.0, 0.2])  # of that search: azimuth and elevation in degrees, distance as a logarithm
TRIES = 24  # renders in the longer search for the camera of the first
STRANGE = 0.55  # misfit above which a picture shows nothing that the generator makes; see docs/results.md
PRIOR = 0.1  # weight of the surprise against the agreement
CAMERA = 0.01  # and of the square of the steps that the camera is from where the network expects it …
FAR = 9.0  # … up to this square
TEMPERATURE = 0.07  # of the score: what makes one candidate e times as likely as another
POINTS = 512  # of a surface, to tell how far apart two candidates are


def rank(estimate: Estimate, report: Callable[[int], None] = lambda built: None) -> Estimate:
    """Build the light mesh of every candidate, and order them by how far from the truth each is expected to be.

    Candidates that are nearly the same are merged; one that cannot be built goes last. `report` is told how many are
    built. The misfit is what the highest agreement lacks of 1.
    """
    judge = Judge(estimate)
    try:
        meshes = estimate.inverter.pool.map([candidate.params for candidate in estimate.candidates])
        seen = []
        for number, (candidate, mesh) in enumerate(zip(estimate.candidates, meshes, strict=True), 1):
            built = not isinstance(mesh, BuildError)
            seen.append(judge.align(judge.look(replace(candidate, mesh=mesh)), GLANCES) if built else candidate)
            report(number)
        first, *others = judge.safest_first(judge.best_first(seen))
        found = [judge.align(first), *others]
    finally:
        judge.close()
    return judged(estimate, merged(estimate, found))


def warning(estimate: Estimate) -> str | None:
    """A sentence when the picture seems to show nothing that the generator makes."""
    if estimate.misfit is None or estimate.misfit <= STRANGE:
        return None
    name = estimate.inverter.generator.name
    return (
        f"the best {name} found agrees with the picture by only {100 * (1 - estimate.misfit):.0f} %; "
        f"perhaps it shows nothing that {name!r} can make."
    )


def turned(view: View, azimuth_deg: float, elevation_deg: float, nearer: float) -> View:
    """The camera moved by two angles and by a factor exp(-nearer) of its distance, within what can be seen from."""
    elevation = min(max(view.elevation_deg + elevation_deg, -MAX_ELEVATION_DEG), MAX_ELEVATION_DEG)
    distance = min(max(view.distance * float(np.exp(-nearer)), NEAREST), FARTHEST)
    return replace(
        view,
        azimuth_deg=(view.azimuth_deg + azimuth_deg + 180) % 360 - 180,
        elevation_deg=elevation,
        distance=distance,
    )


def judged(estimate: Estimate, candidates: list[Candidate]) -> Estimate:
    """The estimate with these candidates and the misfit of the one that agrees best."""
    agreements = [candidate.agreement for candidate in candidates if candidate.agreement is not None]
    return replace(estimate, candidates=candidates, misfit=1 - max(agreements) if agreements else None)


class Judge:
    """Says how good a built candidate is: the picture's view of it, and the network's."""

    def __init__(self, estimate: Estimate) -> None:
        if estimate.background == "words":
            raise ValueError("What was told in words has no picture to be compared with.")
        self.estimate, self.space = estimate, estimate.inverter.generator.space
        self.picture = Picture(estimate.image, estimate.background)
        self.renderer = Renderer(SIDE, samples=0)  # silhouettes are blurred anyway, and this takes half the time
        self._middle = self.space.encode(estimate.expected.params)

    def close(self) -> None:
        """Free the renderer."""
        self.renderer.close()

    def agreement(self, mesh: Mesh, view: View) -> float:
        """How well the mesh matches the picture from there, from 0 to 1."""
        return self.picture.match(self.renderer.render(mesh, view, margin=MARGIN)).agreement

    def look(self, candidate: Candidate, *others: View) -> Candidate:
        """The built candidate with its agreement, from its own camera or from a better one among others."""
        assert candidate.mesh is not None
        views = [candidate.view, self.estimate.expected.view, *others]
        found = [(self.agreement(candidate.mesh, view), number) for number, view in enumerate(views)]
        best, number = max(found)
        return replace(candidate, agreement=best, view=views[number])

    def align(self, candidate: Candidate, tries: int = TRIES) -> Candidate:
        """The same candidate with the camera near its own that agrees best (Nelder & Mead 1965)."""
        mesh, view = candidate.mesh, candidate.view
        if mesh is None or candidate.agreement is None:
            return candidate
        corners = np.vstack([np.zeros(3), np.eye(3)])
        done = minimize(
            lambda step: -self.agreement(mesh, turned(view, *(step * STEPS))),
            np.zeros(3),
            method="Nelder-Mead",
            options={"maxfev": tries, "initial_simplex": corners, "xatol": 1e-2, "fatol": 1e-4},
        )
        if -done.fun <= candidate.agreement:
            return candidate
        return replace(candidate, agreement=float(-done.fun), view=turned(view, *(done.x * STEPS)))

    def score(self, candidate: Candidate) -> float:
        """Agreement, less how little the network would have expected the parameters and the camera."""
        if candidate.agreement is None:
            return -np.inf
        moved = min(apart(candidate.view, self.estimate.expected.view), FAR)
        return candidate.agreement - PRIOR * self.surprise(candidate.params) - CAMERA * moved

    def surprise(self, params: Params) -> float:
        """Mean distance in x from the expected candidate, over active reals, and of choices 1 less their chance."""
        active, x = self.space.active(params), self.space.encode(params)
        apart = np.abs(x - self._middle)
        for i in self.space.choices:
            parameter = self.space.parameters[i]
            apart[i] = 1 - self.estimate.chances[parameter.name][params[parameter.name]]
        return float(apart[active].mean()) if active.any() else 0.0

    def best_first(self, candidates: list[Candidate]) -> list[Candidate]:
        """Ordered by score; those that could not be built last."""
        return sorted(candidates, key=self.score, reverse=True)

    def safest_first(self, candidates: list[Candidate]) -> list[Candidate]:
        """Ordered by the expected distance from the truth, if each is the truth with a chance that its score gives."""
        built = [candidate for candidate in candidates if candidate.mesh is not None]
        if not built:
            return candidates
        scores = np.array([self.score(candidate) for candidate in built])
        chances = np.exp((scores - scores.max()) / TEMPERATURE)
        expected = distances([c.mesh for c in built if c.mesh is not None]) @ chances
        return [built[i] for i in np.argsort(expected, kind="stable")] + [c for c in candidates if c.mesh is None]


def apart(view: View, other: View) -> float:
    """Square of how many `STEPS` two cameras are apart."""
    azimuth = (view.azimuth_deg - other.azimuth_deg + 180) % 360 - 180
    nearness = np.log(view.distance / other.distance)
    return float((([azimuth, view.elevation_deg - other.elevation_deg, nearness] / STEPS) ** 2).sum())


def distances(meshes: list[Mesh]) -> Float[np.ndarray, "n n"]:
    """Chamfer distance of every two meshes, from few points."""
    points = [surface_points(mesh, POINTS, np.random.default_rng(0)) for mesh in meshes]
    trees = [KDTree(p) for p in points]
    one_way = np.array([[tree.query(p)[0].mean() for tree in trees] for p in points])
    return (one_way + one_way.T) / 2


def merged(estimate: Estimate, candidates: list[Candidate]) -> list[Candidate]:
    """The candidates without those that are nearly the same as an earlier one; the unbuilt stay."""
    kept: list[Candidate] = []
    for candidate in candidates:
        if candidate.mesh is None or not any(_same(estimate, candidate, other) for other in kept):
            kept.append(candidate)
    return kept


def _same(estimate: Estimate, a: Candidate, b: Candidate) -> bool:
    space = estimate.inverter.generator.space
    if b.mesh is None or any(isinstance(p, Choice) and a.params[p.name] != b.params[p.name] for p in space):
        return False
    reals = space.active(a.params)
    reals[space.choices] = False
    apart = np.abs(space.encode(a.params) - space.encode(b.params))[reals]
    return not len(apart) or float(apart.mean()) < SAME
