"""What all visitors share: estimators, warm workers, and one thread for the network and OpenGL.

Nothing of a visitor is kept here, so one visitor's crash, hang or bad file is that visitor's alone.
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
from dipcg.images import MARGIN, Source
from dipcg.inference.preview import TOLD_VIEW
from dipcg.inference.rank import merged, rank
from dipcg.inference.recognise import recognisable, recognise
from dipcg.mesh import Mesh
from dipcg.model.zoo import find_checkpoint
from dipcg.pipeline import Estimate, Inverter
from dipcg.render import Renderer
from dipcg.space import did_you_mean
from dipcg.workers.process import BuildError

CANDIDATES = 8  # of the strip
MOST_CANDIDATES = 32  # that one visitor may ask for
MOST_WORKERS = 2  # of each generator
TILE = 256  # side of a candidate's picture

Report = Callable[[float, str], None]
T = TypeVar("T")


class Studio:
    """The estimators of several generators behind plain functions that any thread may call; a context manager.

    `names` are generators or folders with checkpoints; all that ship and can be built here when there are none.
    Raises LookupError for an unknown name and weights.CheckpointError with a sentence.
    """

    def __init__(self, names: Sequence[str] = (), workers: int | None = None) -> None:
        names = list(names) or recognisable()
        count = workers or max(1, min(MOST_WORKERS, (os.cpu_count() or 1) // len(names)))
        loaded = [Inverter.load(name, count) for name in names]
        self.inverters: dict[str, Inverter] = {inverter.generator.name: inverter for inverter in loaded}
        self._readers: dict[str, Inverter] = {}
        self._one = ThreadPoolExecutor(1, thread_name_prefix="estimate")  # an OpenGL context belongs to one thread
        for inverter in loaded:
            inverter.pool.warm()

    @property
    def names(self) -> list[str]:
        """The generators, in the order in which they were named."""
        return list(self.inverters)

    def find(self, name: str) -> Inverter:
        """The estimator of a generator; raises ValueError with the nearest name."""
        if name not in self.inverters:
            near = did_you_mean(str(name), self.names)
            raise ValueError(f"There is no generator {name!r} here.{near} There are: {', '.join(self.names)}.")
        return self.inverters[name]

    def recognise(self, picture: Source) -> list[tuple[str, float]]:
        """The generators with the chance that the picture shows what they make; raises images.ImageError."""
        if len(self.inverters) == 1:
            return [(self.names[0], 1.0)]
        return self._alone(lambda: recognise(picture, self.inverters))

    def estimate(
        self,
        picture: Source,
        name: str,
        keep: Mapping[str, Any] | None = None,
        candidates: int = CANDIDATES,
        seed: int = 0,
        report: Report = lambda share, words: None,
    ) -> Estimate:
        """Candidates with their light meshes, those that match the picture best first.

        Raises images.ImageError, ValueError for values that cannot be held, and worker.BuildError when none is built.
        """
        inverter, candidates = self.find(name), _few(candidates)

        def told(built: int) -> None:
            report(0.3 + 0.7 * built / candidates, "Building and comparing the candidates")

        def work() -> Estimate:
            report(0.1, "Estimating the parameters")
            found = inverter.estimate(picture, candidates, seed=seed, keep=keep)
            ranked = rank(found, told)
            # A worker that was killed meanwhile costs a second ranking, and no candidate.
            return ranked if all(c.mesh for c in ranked.candidates) else rank(found, told)

        return _only_built(self._alone(work))

    def recognise_text(self, text: str) -> list[tuple[str, float]]:
        """The generators with the chance that a sentence asks for each; raises ValueError with a sentence."""
        from dipcg.inference.recognise_text import recognise_text

        return [(self.names[0], 1.0)] if len(self.inverters) == 1 else list(recognise_text(text, self.names).items())

    def describe(
        self,
        text: str,
        name: str,
        keep: Mapping[str, Any] | None = None,
        candidates: int = CANDIDATES,
        seed: int = 0,
        report: Report = lambda share, words: None,
    ) -> Estimate:
        """Candidates for what a sentence says, with their light meshes, all from one side; the expected one first.

        Raises ValueError, weights.CheckpointError where a generator has no estimator that reads words, and
        worker.BuildError when none is built.
        """
        inverter = self.find(name)
        report(0.1, "Reading")
        found = self._alone(lambda: self._reader(name).describe(text, _few(candidates), seed=seed, keep=keep))
        report(0.3, "Building the candidates")
        meshes = inverter.pool.map(candidate.params for candidate in found.candidates)
        view = replace(inverter.generator.views.middle, azimuth_deg=TOLD_VIEW.azimuth_deg)
        seen = [
            replace(candidate, view=view, mesh=None if isinstance(mesh, BuildError) else mesh)
            for candidate, mesh in zip(found.candidates, meshes, strict=True)
        ]
        return _only_built(replace(found, candidates=merged(found, seen)))

    def build(self, name: str, params: Mapping[str, Any], detail: Detail = "light") -> Asset:
        """Build checked parameters, a second time when the worker died; raises ValueError and worker.BuildError."""
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
        for inverter in self.inverters.values():
            inverter.close()

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _reader(self, name: str) -> Inverter:
        """The estimator that reads words, loaded when they are first given; what it finds is built by the other's."""
        if name not in self._readers:
            self._readers[name] = Inverter.load(str(find_checkpoint(name, "text")))
        return self._readers[name]

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(TILE)

    def _alone(self, work: Callable[[], T]) -> T:
        return self._one.submit(work).result()


def _few(candidates: int) -> int:
    if not 1 <= candidates <= MOST_CANDIDATES:
        raise ValueError(f"From 1 to {MOST_CANDIDATES} candidates can be asked for, got {candidates}.")
    return candidates


def _only_built(found: Estimate) -> Estimate:
    built = [candidate for candidate in found.candidates if candidate.mesh is not None]
    if not built:
        raise BuildError("raised", "None of the candidates could be built; try another picture or another seed.")
    return replace(found, candidates=built)
