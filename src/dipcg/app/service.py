"""The state that all visitors share: estimators, warm workers, and one thread for the network and OpenGL.

Nothing of a visitor is kept here, so a crash, a hang or a bad file of one visitor affects no other.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from jaxtyping import UInt8

from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.generators import Detail
from dipcg.images import MARGIN, Cutout, Source
from dipcg.inference.estimate import Options, Report, Result, describe, estimate
from dipcg.inference.inverters import Inverters, recognisable
from dipcg.inference.preview import TEXT_VIEW
from dipcg.inference.rank import light_meshes, merge
from dipcg.mesh import Mesh
from dipcg.pipeline import Candidate, Estimate, Inverter
from dipcg.render import Renderer
from dipcg.workers.process import BuildError

# Candidates of an estimate for the page.
CANDIDATES = 8
# The most candidates that a request may ask for.
MAX_CANDIDATES = 32
# The most workers of each generator.
MAX_WORKERS = 2
# Side of a candidate's picture.
TILE = 256

T = TypeVar("T")


class Studio:
    """The estimators of several generators behind plain functions that any thread may call; a context manager.

    `names` are generators or folders with checkpoints; without names all that ship and can be built here.
    Raises LookupError for an unknown name and zoo.CheckpointError with a sentence.
    """

    def __init__(self, names: Sequence[str] = (), workers: int | None = None, candidates: int = CANDIDATES) -> None:
        names = list(names) or recognisable()
        count = workers or max(1, min(MAX_WORKERS, (os.cpu_count() or 1) // len(names)))
        self.candidates = candidates
        self.inverters = Inverters(names, count)
        self.text_inverters = Inverters(self.names, reads="text")
        # One thread, since an OpenGL context belongs to the thread that made it.
        self._one = ThreadPoolExecutor(1, thread_name_prefix="estimate")
        for inverter in self.inverters.values():
            inverter.pool.warm()

    @property
    def names(self) -> list[str]:
        """The generators, in the order in which they were named."""
        return list(self.inverters)

    def find(self, name: str) -> Inverter:
        """The estimator of a generator; raises ValueError with the nearest name."""
        return self.inverters.find(name)

    def estimate(self, picture: Source | Cutout, options: Options, report: Report = lambda share, note: None) -> Result:
        """The result for a picture, of candidates that could be built.

        Raises images.ImageError, ValueError for options that cannot be used, and BuildError when none is built.
        """
        _check(options)
        result = self._alone(lambda: estimate(picture, self.inverters, options, report))
        return _with_candidates(result, result.estimate.candidates)

    def describe(self, text: str, options: Options, report: Report = lambda share, note: None) -> Result:
        """The result for a sentence, of candidates that could be built, all from one side; the expected one first.

        Raises ValueError, zoo.CheckpointError where a generator has no estimator that reads text, and BuildError when
        none is built.
        """
        _check(options)
        result = self._alone(lambda: describe(text, self.text_inverters, options, report))
        report(0.3, "Building the candidates")
        return _with_candidates(result, self._built(result.estimate))

    def build(self, name: str, params: Mapping[str, Any], detail: Detail = "light") -> Asset:
        """Build checked parameters, a second time when the worker died; raises ValueError and BuildError."""
        inverter = self.find(name)
        checked = inverter.generator.space.validate(params)
        try:
            return inverter.build(checked, detail)
        except BuildError as error:
            if error.reason != "crashed":
                raise
            return inverter.build(checked, detail)

    def tiles(self, meshes: Sequence[tuple[Mesh, View]]) -> list[UInt8[np.ndarray, "s s 4"]]:
        """Each mesh from its own camera."""
        return self._alone(lambda: [self._renderer.render(mesh, view, margin=MARGIN) for mesh, view in meshes])

    def close(self) -> None:
        """Stop the workers and the thread."""
        self._one.shutdown(wait=True, cancel_futures=True)
        self.inverters.close()
        self.text_inverters.close()

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _built(self, estimate: Estimate) -> list[Candidate]:
        """The different candidates from a text, with light meshes that the workers of the other estimator build."""
        inverter = self.find(estimate.generator)
        meshes = light_meshes(inverter, (candidate.params for candidate in estimate.candidates))
        view = replace(inverter.generator.views.middle, azimuth_deg=TEXT_VIEW.azimuth_deg)
        seen = [
            replace(candidate, view=view, mesh=None if isinstance(mesh, BuildError) else mesh)
            for candidate, mesh in zip(estimate.candidates, meshes, strict=True)
        ]
        return merge(seen, inverter.generator.space)

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(TILE)

    def _alone(self, work: Callable[[], T]) -> T:
        return self._one.submit(work).result()


def _check(options: Options) -> None:
    if not 1 <= options.candidates <= MAX_CANDIDATES:
        raise ValueError(f"From 1 to {MAX_CANDIDATES} candidates can be asked for, got {options.candidates}.")


def _with_candidates(result: Result, candidates: Sequence[Candidate]) -> Result:
    """The result with those of the candidates that are built."""
    built = [candidate for candidate in candidates if candidate.mesh is not None]
    if not built:
        raise BuildError("raised", "None of the candidates could be built; try another picture or another seed.")
    return replace(result, estimate=replace(result.estimate, candidates=built))
