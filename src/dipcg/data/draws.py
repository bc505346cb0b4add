"""Which parameters a data set holds: a function of its seed, the way of drawing and the number of the sample alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from dipcg.generators import Generator
from dipcg.space import ParameterSpace, Params

Drawing = Literal["uniform", "sobol"]


@dataclass(frozen=True)
class Draws:
    """The samples of a data set before they are built.

    With `sobol` they are the points of a scrambled Sobol sequence (Owen 1998), which cover the space more evenly than
    independent ones. That helps with few samples, say below ten thousand.
    """

    generator: Generator
    seed: int = 0
    drawing: Drawing = "uniform"

    def params(self, numbers: range) -> list[Params]:
        """The parameters of consecutive samples."""
        space = self.generator.space
        if self.drawing == "sobol":
            return [space.decode(2 * u - 1) for u in _sobol(space, self.seed, numbers)]
        return [space.sample(np.random.default_rng([self.seed, number])) for number in numbers]

    def describe(self) -> dict[str, Any]:
        """The values by which one data set differs from another, ready for JSON."""
        generator = self.generator
        return {
            "generator": generator.name,
            "fingerprint": generator.space.fingerprint,
            "ref": generator.ref,
            "seed": self.seed,
            "drawing": self.drawing,
        }


def _sobol(space: ParameterSpace, seed: int, numbers: range) -> np.ndarray:
    import warnings

    from scipy.stats import qmc

    points = qmc.Sobol(len(space), rng=seed)
    if numbers.start:
        points.fast_forward(numbers.start)
    with warnings.catch_warnings():
        # SciPy warns of a number that is no power of two, but the data set may grow to one.
        warnings.simplefilter("ignore", UserWarning)
        return points.random(len(numbers))
