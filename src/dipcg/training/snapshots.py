"""Pictures for the log of training: estimates beside their photos, made in a thread so that training does not wait."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from dipcg.data.store import Store
from dipcg.generators import Generator
from dipcg.images import MARGIN, over_white, prepare
from dipcg.inference.preview import in_rows
from dipcg.mesh import Mesh
from dipcg.model.checkpoint import load_checkpoint
from dipcg.model.zoo import WEIGHTS
from dipcg.pipeline import Estimate, Inverter
from dipcg.render import Renderer, sample_look
from dipcg.workers.child import describe
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError

# The number of validation shapes, and the side of their pictures in pixels.
SHAPES, SIDE = 4, 192
# The limit of sampling steps, because the paper's model is configured with 250.
MAX_STEPS = 25
# The time limit of a light build, in seconds.
BUILD_LIMIT_S = 10.0
# The time in seconds that the end of training waits for the last pictures.
CLOSE_LIMIT_S = 10.0
# The niceness that is added to that of training, so that the pictures do not slow it down.
NICENESS = 10
# The name of the pictures in TensorBoard.
TAG = "photo beside estimate"


class Snapshots:
    """Writes estimates of a few validation shapes by the best weights so far to TensorBoard.

    For chairs this takes 1.3 s of one processor, and 4 s more the first time, at a low priority. An error is written to
    TensorBoard as a text.
    """

    def __init__(self, checkpoint: Path, data: str | Path, writer: Any) -> None:
        self._checkpoint, self._data, self._writer = checkpoint, data, writer
        # On Linux a thread has a priority of its own, and the worker that it starts inherits it.
        self._thread = ThreadPoolExecutor(1, "snapshots", os.nice, (NICENESS,))
        self._running: Future[None] | None = None
        self._pool: BuildPool | None = None
        self._photos: list[UInt8[np.ndarray, "s s 4"]] = []
        # The time of the last weights that were shown.
        self._written = 0

    def take(self, pictures: int) -> None:
        """Start to show the checkpoint after `pictures` training pictures, unless the last start is not finished."""
        if self._running is None or self._running.done():
            self._running = self._thread.submit(self._take, pictures)

    def close(self) -> None:
        """Wait for unfinished pictures, up to the time limit, and stop the worker."""
        if self._running is not None:
            wait([self._running], CLOSE_LIMIT_S)
        if self._pool is not None:
            self._pool.close()
        self._thread.shutdown(wait=False)

    def _take(self, pictures: int) -> None:
        try:
            written = (self._checkpoint / WEIGHTS).stat().st_mtime_ns
            if written != self._written:
                self._writer.add_image(TAG, self._sheet(), pictures, dataformats="HWC")
            self._written = written
        # Training goes on after any error of a generator, a driver or a file.
        except Exception as error:
            self._writer.add_text(TAG, f"The pictures could not be made: {describe(error)}.", pictures)

    def _sheet(self) -> UInt8[np.ndarray, "h w 3"]:
        """One row for each shape: its photo and the render of its estimate."""
        model, generator, _ = load_checkpoint(self._checkpoint)
        model.config = replace(model.config, steps=min(model.config.steps, MAX_STEPS))
        self._pool = self._pool or BuildPool(generator.ref, 1, BUILD_LIMIT_S)
        renderer, inverter = Renderer(SIDE), Inverter(model, generator)
        self._photos = self._photos or list(_photos(self._data, generator, renderer))
        estimates = [inverter.estimate(photo, candidates=1) for photo in self._photos]
        meshes = self._pool.map([estimate.params for estimate in estimates], "light")
        tiles = [tile for pair in zip(estimates, meshes, strict=True) for tile in _pair(*pair, renderer)]
        renderer.close()
        return in_rows(tiles, 2)


def _photos(data: str | Path, generator: Generator, renderer: Renderer) -> Iterator[UInt8[np.ndarray, "s s 4"]]:
    """Renders of the first validation shapes, from the same cameras in every run."""
    rng = np.random.default_rng(0)
    built = ((sample.params, sample.mesh) for sample in Store(data).samples("validation") if sample.mesh)
    for params, mesh in islice(built, SHAPES):
        view, look = generator.seen_from(params).sample(rng), sample_look(rng, len(mesh.part_names))
        yield np.ascontiguousarray(renderer.render(mesh, view, look, MARGIN))


def _pair(estimate: Estimate, mesh: Mesh | BuildError, renderer: Renderer) -> list[UInt8[np.ndarray, "s s 3"]]:
    """The photo and the render of its estimate, which is grey where the build failed."""
    photo = over_white(prepare(estimate.image, SIDE)[0])
    if isinstance(mesh, BuildError):
        return [photo, np.full_like(photo, 128)]
    return [photo, over_white(renderer.render(mesh, estimate.view, margin=MARGIN))]
