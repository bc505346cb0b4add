"""CMA-ES, the evolution strategy of both searches (Hansen 2016, as implemented by `cma`)."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

# CMA-ES ranks numbers, so that a point that cannot be built has this score and not an infinite one.
WORST = 1e3


class EvolutionStrategy:
    """CMA-ES from one start; `ask` gives points, `tell` takes their scores, of which lower ones are better.

    With `bounded` all points lie in [-1, 1]^n. A choice is the piece of [-1, 1] that its number lies in. All random
    numbers come from `rng`.
    """

    def __init__(
        self,
        start: Float[np.ndarray, " n"],
        step: float,
        rng: np.random.Generator,
        population: int | None = None,
        bounded: bool = True,
    ) -> None:
        import cma

        options = {"verbose": -9, "randn": lambda *shape: rng.standard_normal(shape), "seed": math.nan}
        options |= {"popsize": population} if population else {}
        options |= {"bounds": [-1, 1]} if bounded else {}
        self._inner = cma.CMAEvolutionStrategy(start, step, options)

    def ask(self) -> list[Float[np.ndarray, " n"]]:
        """The points of the next generation."""
        return [np.asarray(point, float) for point in self._inner.ask()]

    def tell(self, points: list[Float[np.ndarray, " n"]], scores: list[float]) -> None:
        """The scores of these points."""
        self._inner.tell(points, [min(score, WORST) for score in scores])
