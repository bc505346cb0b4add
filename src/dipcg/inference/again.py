"""A second look: the best candidate is drawn, read as the picture was, and moved by what the two readings differ."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from dipcg.inference.correct import Corrector
from dipcg.inference.rank import Judge, compared, light_meshes, merge, with_candidates
from dipcg.mesh import Mesh
from dipcg.pipeline import Candidate, Estimate, Inverter
from dipcg.space import ParameterSpace
from dipcg.workers.process import BuildError

# The whole correction, and half of it.
COUNT = 2


def look_again(estimate: Estimate, inverter: Inverter) -> Estimate:
    """A ranked estimate of one picture, with a corrected candidate before the first if it agrees better.

    Two light meshes are built. An estimate that is not ranked, and one of a network without a direct guess, stay.
    """
    candidates = corrections(estimate, inverter)
    meshes = light_meshes(inverter, [candidate.params for candidate in candidates])
    return improved(estimate, candidates, meshes, inverter.generator.space)


def corrections(estimate: Estimate, inverter: Inverter) -> list[Candidate]:
    """The first candidate, moved by the whole correction and by half of it; none of them is built."""
    if estimate.misfit is None or not inverter.model.makes_guess:
        return []
    corrector = Corrector(estimate, inverter, np.random.default_rng(0))
    try:
        return [Candidate(*moved) for moved in corrector.suggest(estimate.candidates[0])[:COUNT]]
    finally:
        corrector.close()


def improved(
    estimate: Estimate, candidates: list[Candidate], meshes: Iterable[Mesh | BuildError], space: ParameterSpace
) -> Estimate:
    """The ranked estimate with the best of these candidates before the first, if its score is higher."""
    if not candidates:
        return estimate
    first, judge = estimate.candidates[0], Judge(estimate, space)
    try:
        seen = [compared(judge, c, mesh, first.view) for c, mesh in zip(candidates, meshes, strict=True)]
        built = [candidate for candidate in seen if candidate.mesh is not None]
        best = max([first, *built], key=judge.score)
        if best is first:
            return estimate
        best = judge.align(best)
    finally:
        judge.close()
    # As many candidates as before: the last is the least likely.
    return with_candidates(estimate, merge([best, *estimate.candidates], space)[: len(estimate.candidates)])
