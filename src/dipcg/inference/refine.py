"""Searching on from the best candidate: the network's own corrections, and an evolution strategy beside them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from dipcg.camera import View
from dipcg.inference.correct import Corrector, can_correct
from dipcg.inference.evolution import EvolutionStrategy
from dipcg.inference.rank import Judge, judged, merged, rank
from dipcg.mesh import Mesh
from dipcg.pipeline import Candidate, Estimate, Step
from dipcg.space import Choice, Parameter, Params, Real, Value
from dipcg.workers.process import BuildError

GENERATION = 8  # builds between two updates of the search
LEAST, MOST = 0.05, 0.4  # first step of a parameter in x: its spread, within these
FIRST_STEP = 0.5  # of the spread
JUMPS = 2  # of a generation, in which one choice is another
LEAST_CHANCE = 0.02  # added to the chance of each option that a jump may take
LEAST_GAIN = 1e-3  # of the score, less than which is no gain
PATIENCE = 6  # generations without a better one, after which the search stops
TRUST = 2  # generations without the best among the network's corrections, after which it is not asked again
NEAR = 0.03  # agreement below the best within which a camera is searched for
TRIES = 12  # renders for that


def refine(
    estimate: Estimate,
    seconds: float | int,
    report: Callable[[Step], None] = lambda step: None,
    most_builds: int | None = None,
    seed: int = 0,
) -> Estimate:
    """Search for parameters and a camera that match the picture better, for so many seconds or builds.

    Ranks first where that was not done. What is held stays so. Ends early when nothing better is found. The result
    is the best candidate, then the others, with the trace of the search. Raises ValueError for seconds or builds
    that are not above 0. Source: CMA-ES, Hansen 2016, as implemented by `cma`.
    """
    if not seconds > 0 or (most_builds is not None and most_builds < 1):
        raise ValueError(f"A search needs more than 0 seconds and builds, got {seconds:g} s and {most_builds}.")
    started = time.monotonic()
    ranked = estimate if estimate.misfit is not None else rank(estimate)
    if ranked.misfit is None:  # nothing can be built, so there is nothing to search on from
        return ranked
    search = Search(ranked, started, seed)
    try:
        while search.goes_on(seconds, most_builds):
            report(search.generation())
        last = search.judge.align(search.best, 2 * TRIES)
    finally:
        search.close()
    found = judged(ranked, merged(ranked, [last, *ranked.candidates]))
    return replace(found, trace=search.trace)


class Search:
    """The state of a search: the best candidate, and a strategy around it that is started anew after a jump."""

    def __init__(self, estimate: Estimate, started: float, seed: int) -> None:
        self.estimate, self.space = estimate, estimate.inverter.generator.space
        self.judge, self.rng = Judge(estimate), np.random.default_rng(seed)
        self._corrector = Corrector(estimate, self.rng) if can_correct(estimate) else None
        self._trust = TRUST
        self.best = estimate.candidates[0]
        self.builds, self.idle, self._started, self._took = 0, 0, started, 0.0
        self.trace = [self._step()]
        self._start()

    def close(self) -> None:
        """Free the renderers."""
        self.judge.close()
        if self._corrector:
            self._corrector.close()

    def goes_on(self, seconds: float, most_builds: int | None) -> bool:
        """Whether there is time for another generation, and hope."""
        left = seconds - (time.monotonic() - self._started)
        enough = most_builds is not None and self.builds >= most_builds
        return left > self._took and not enough and self.idle < PATIENCE

    def generation(self) -> Step:
        """Build and judge one generation, and move on to what it found."""
        begun, before = time.monotonic(), self.judge.score(self.best)
        points = self._strategy.ask()
        jumps, corrected = self._jumps(), self._corrections()
        found = self._judged([*((self._params(point), self.best.view) for point in points), *jumps, *corrected])
        scores = [self.judge.score(candidate) for candidate in found]
        self._strategy.tell(points, [-score for score in scores[: len(points)]])
        first = int(np.argmax(scores))
        if scores[first] > before:
            self.best = found[first]
            if first >= len(points):
                self._start()
        if first < len(points) + len(jumps) or scores[first] <= before:
            self._trust -= 1
        self.idle = 0 if scores[first] > before + LEAST_GAIN else self.idle + 1
        self._took = time.monotonic() - begun
        self.trace.append(self._step())
        return self.trace[-1]

    def _start(self) -> None:
        """A new strategy around the best, over the active reals that are not held, in units of their spread."""
        active, kept = self.space.active(self.best.params), self.estimate.kept
        self._free = [i for i in self.space.reals if active[i] and self.space.names[i] not in kept]
        self._centre = self.space.encode(self.best.params)
        self._scale = np.array([self._spread(self.space.parameters[i]) for i in self._free])
        start = np.zeros(max(2, len(self._free)))
        self._strategy = EvolutionStrategy(start, FIRST_STEP, self.rng, GENERATION - JUMPS, bounded=False)

    def _spread(self, parameter: Parameter) -> float:
        assert isinstance(parameter, Real)
        spread = 2 * self.estimate.spread[parameter.name] / (parameter.high - parameter.low)
        return float(np.clip(spread, LEAST, MOST))

    def _params(self, point: Float[np.ndarray, " n"]) -> Params:
        x = self._centre.copy()
        x[self._free] += self._scale * point[: len(self._free)]
        return self.space.replace(self.space.decode(x), self.estimate.kept)

    def _corrections(self) -> list[tuple[Params, View]]:
        return self._corrector.suggest(self.best) if self._corrector and self._trust > 0 else []

    def _jumps(self) -> list[tuple[Params, View]]:
        jumps = (self._jump() for _ in range(JUMPS))
        return [(params, self.best.view) for params in jumps if params is not None]

    def _jump(self) -> Params | None:
        """The best with another option of one choice, likelier ones more often; None where every choice is held."""
        best, kept = self.best.params, self.estimate.kept
        open_choices = [p for p in self.space if isinstance(p, Choice) and p.name not in kept]
        active = [p for p in open_choices if self.space.is_active(p.name, best)]
        others = [(p.name, option) for p in active for option in p.options if option != best[p.name]]
        if not others:
            return None
        weights = np.array([self.estimate.chances[name][option] + LEAST_CHANCE for name, option in others])
        name, option = others[int(self.rng.choice(len(others), p=weights / weights.sum()))]
        return self.space.replace(self._donor(name, option) | self._active(best) | {name: option}, kept)

    def _donor(self, name: str, option: Value) -> Params:
        """A candidate that has this option, for what becomes active with it."""
        having = [c.params for c in self.estimate.candidates if c.params[name] == option]
        return having[int(self.rng.integers(len(having)))] if having else self.estimate.expected.params

    def _active(self, params: Params) -> Params:
        return {name: value for name, value in params.items() if self.space.is_active(name, params)}

    def _judged(self, many: list[tuple[Params, View]]) -> list[Candidate]:
        meshes = self.estimate.inverter.pool.map([params for params, _ in many])
        self.builds += len(many)
        return [self._judge_one(*one, mesh) for one, mesh in zip(many, meshes, strict=True)]

    def _judge_one(self, params: Params, view: View, mesh: Mesh | BuildError) -> Candidate:
        if isinstance(mesh, BuildError):
            return Candidate(params, view)
        seen = self.judge.look(Candidate(params, view, mesh=mesh), self.best.view)
        near = self.judge.score(seen) > self.judge.score(self.best) - NEAR
        return self.judge.align(seen, TRIES) if near else seen

    def _step(self) -> Step:
        assert self.best.agreement is not None
        return Step(time.monotonic() - self._started, self.builds, 1 - self.best.agreement)
