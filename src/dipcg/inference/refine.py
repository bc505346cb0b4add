"""Searching on from the best candidate: corrections by the network, an evolution strategy, and jumps of choices."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from dipcg.camera import View
from dipcg.inference.correct import Corrector
from dipcg.inference.evolution import EvolutionStrategy
from dipcg.inference.rank import Judge, light_meshes, merge, rank, with_candidates
from dipcg.mesh import Mesh
from dipcg.pipeline import Candidate, Estimate, Inverter, Step
from dipcg.space import Choice, Parameter, Params, Real, Value
from dipcg.workers.process import BuildError

# Builds between two updates of the search.
GENERATION = 8
# The first step of a parameter in x is a share of its spread, and the spread is clipped to these limits.
FIRST_STEP, LEAST_SPREAD, MOST_SPREAD = 0.5, 0.05, 0.4
# Builds of a generation in which one choice has another option.
JUMPS = 2
# Added to the probability of each option that a jump may take.
LEAST_PROBABILITY = 0.02
# The least gain of the score that counts as one.
LEAST_GAIN = 1e-3
# Generations without a gain after which the search stops.
PATIENCE = 6
# Generations without the best among the network's corrections after which they are no longer tried.
CORRECTION_PATIENCE = 2
# Difference from the best score within which a candidate's camera is searched for, and the renders for that.
NEAR, RENDERS = 0.03, 12


def refine(
    estimate: Estimate,
    inverter: Inverter,
    seconds: float | int,
    report: Callable[[Step], None] = lambda step: None,
    most_builds: int | None = None,
    seed: int = 0,
) -> Estimate:
    """Search for parameters and a camera that match the picture better, for so many seconds or builds.

    Candidates that are not ranked yet are ranked first. Fixed values stay. The search ends early when it finds nothing
    better. The result has the best candidate, then the others, and the trace of the search. Raises ValueError for
    seconds or builds that are not above 0.
    """
    if not seconds > 0 or (most_builds is not None and most_builds < 1):
        raise ValueError(f"A search needs more than 0 seconds and builds, got {seconds:g} s and {most_builds}.")
    started = time.monotonic()
    ranked = estimate if estimate.misfit is not None else rank(estimate, inverter)
    if ranked.misfit is None:
        # No candidate can be built, so there is nothing to start from.
        return ranked
    search = Search(ranked, inverter, started, seed)
    try:
        while search.goes_on(seconds, most_builds):
            report(search.generation())
        last = search.judge.align(search.best, 2 * RENDERS)
    finally:
        search.close()
    candidates = merge([last, *ranked.candidates], inverter.generator.space)
    return replace(with_candidates(ranked, candidates), trace=search.trace)


class Search:
    """The state of a search: the best candidate, and a strategy around it that is started anew after a jump."""

    def __init__(self, estimate: Estimate, inverter: Inverter, started: float, seed: int) -> None:
        self.estimate, self.inverter, self.space = estimate, inverter, inverter.generator.space
        self.judge, self.rng = Judge(estimate, self.space), np.random.default_rng(seed)
        self._corrector = Corrector(estimate, inverter, self.rng) if inverter.model.makes_guess else None
        self._corrections_left = CORRECTION_PATIENCE
        self.best = estimate.candidates[0]
        self.builds, self.idle, self._started, self._took = 0, 0, started, 0.0
        self.trace = [self._step()]
        self._start()

    def close(self) -> None:
        """Free the renderers."""
        self.judge.close()
        if self._corrector:
            self._corrector.close()

    def goes_on(self, seconds: float | int, most_builds: int | None) -> bool:
        """Whether there is time for another generation, and one of the last ones found something better."""
        left = seconds - (time.monotonic() - self._started)
        enough = most_builds is not None and self.builds >= most_builds
        return left > self._took and not enough and self.idle < PATIENCE

    def generation(self) -> Step:
        """Build and judge one generation, and move to its best candidate if that is better."""
        begun, before = time.monotonic(), self.judge.score(self.best)
        points = self._strategy.ask()
        jumps, corrected = self._jumps(), self._corrections()
        tried = self._build([*((self._params(point), self.best.view) for point in points), *jumps, *corrected])
        scores = [self.judge.score(candidate) for candidate in tried]
        self._strategy.tell(points, [-score for score in scores[: len(points)]])
        first = int(np.argmax(scores))
        if scores[first] > before:
            self.best = tried[first]
            if first >= len(points):
                self._start()
        if first < len(points) + len(jumps) or scores[first] <= before:
            self._corrections_left -= 1
        self.idle = 0 if scores[first] > before + LEAST_GAIN else self.idle + 1
        self._took = time.monotonic() - begun
        self.trace.append(self._step())
        return self.trace[-1]

    def _start(self) -> None:
        """Start a new strategy at the best, over the active reals that are not fixed, in units of their spread."""
        active, fixed = self.space.active(self.best.params), self.estimate.fixed
        self._free = [i for i in self.space.reals if active[i] and self.space.names[i] not in fixed]
        self._centre = self.space.encode(self.best.params)
        self._scale = np.array([self._spread(self.space.parameters[i]) for i in self._free])
        start = np.zeros(max(2, len(self._free)))
        self._strategy = EvolutionStrategy(start, FIRST_STEP, self.rng, GENERATION - JUMPS, bounded=False)

    def _spread(self, parameter: Parameter) -> float:
        assert isinstance(parameter, Real)
        spread = 2 * self.estimate.spread.get(parameter.name, 0.0) / (parameter.high - parameter.low)
        return float(np.clip(spread, LEAST_SPREAD, MOST_SPREAD))

    def _params(self, point: Float[np.ndarray, " n"]) -> Params:
        x = self._centre.copy()
        x[self._free] += self._scale * point[: len(self._free)]
        return self.space.replace(self.space.decode(x), self.estimate.fixed)

    def _corrections(self) -> list[tuple[Params, View]]:
        return self._corrector.suggest(self.best) if self._corrector and self._corrections_left > 0 else []

    def _jumps(self) -> list[tuple[Params, View]]:
        jumps = (self._jump() for _ in range(JUMPS))
        return [(params, self.best.view) for params in jumps if params is not None]

    def _jump(self) -> Params | None:
        """The best with another option of one choice, likelier ones more often; None where every choice is fixed."""
        best, fixed = self.best.params, self.estimate.fixed
        free = [p for p in self.space if isinstance(p, Choice) and p.name not in fixed]
        active = [p for p in free if self.space.is_active(p.name, best)]
        others = [(p.name, option) for p in active for option in p.options if option != best[p.name]]
        if not others:
            return None
        weights = np.array([self.estimate.probabilities[name][option] + LEAST_PROBABILITY for name, option in others])
        name, option = others[int(self.rng.choice(len(others), p=weights / weights.sum()))]
        return self.space.replace(self._donor(name, option) | self._active(best) | {name: option}, fixed)

    def _donor(self, name: str, option: Value) -> Params:
        """A candidate with this option, whose values are taken for parameters that become active with it."""
        having = [c.params for c in self.estimate.candidates if c.params[name] == option]
        return having[int(self.rng.integers(len(having)))] if having else self.estimate.expected.params

    def _active(self, params: Params) -> Params:
        return {name: value for name, value in params.items() if self.space.is_active(name, params)}

    def _build(self, many: list[tuple[Params, View]]) -> list[Candidate]:
        meshes = light_meshes(self.inverter, [params for params, _ in many])
        self.builds += len(many)
        return [self._judge(*one, mesh) for one, mesh in zip(many, meshes, strict=True)]

    def _judge(self, params: Params, view: View, mesh: Mesh | BuildError) -> Candidate:
        if isinstance(mesh, BuildError):
            return Candidate(params, view)
        seen = self.judge.look(Candidate(params, view, mesh=mesh), self.best.view)
        near = self.judge.score(seen) > self.judge.score(self.best) - NEAR
        return self.judge.align(seen, RENDERS) if near else seen

    def _step(self) -> Step:
        assert self.best.agreement is not None
        return Step(time.monotonic() - self._started, self.builds, 1 - self.best.agreement)
