"""Pictures for the log of training: photo beside estimate, made in a thread so that training does not wait for them."""

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

SHOWN, SIDE = 4, 192
STEPS = 25  # at most, for the paper's model, whose answer takes 250
BUILD_S = 10.0  # after which a light build is given up
LAST_S = 10.0  # that the end of training waits for the last pictures
LOW = 10  # nice
TAG = "photo beside estimate"


class Snapshots:
    """Shows what the best weights so far make of a few validation shapes, on a board of TensorBoard.

    For chairs 1.3 s of one processor, and 4 s more the first time, at a low priority. Whatever goes wrong becomes a
    text on the board.
    """

    def __init__(self, checkpoint: Path, data: str | Path, board: Any) -> None:
        self._checkpoint, self._data, self._board = checkpoint, data, board
        # On Linux the priority is the thread's own, and that of the worker which it starts.
        self._thread = ThreadPoolExecutor(1, "snapshots", os.nice, (LOW,))
        self._running: Future[None] | None = None
        self._pool: BuildPool | None = None
        self._photos: list[UInt8[np.ndarray, "s s 4"]] = []
        self._written = 0  # when the weights that are shown were

    def take(self, pictures: int) -> None:
        """Show the checkpoint as it is after so many pictures; returns at once, without when the last is unfinished."""
        if self._running is None or self._running.done():
            self._running = self._thread.submit(self._take, pictures)

    def close(self) -> None:
        """Wait a little for what is being made, and stop the worker."""
        if self._running is not None:
            wait([self._running], LAST_S)
        if self._pool is not None:
            self._pool.close()
        self._thread.shutdown(wait=False)

    def _take(self, pictures: int) -> None:
        try:
            written = (self._checkpoint / WEIGHTS).stat().st_mtime_ns
            if written != self._written:
                self._board.add_image(TAG, self._sheet(), pictures, dataformats="HWC")
            self._written = written
        except Exception as error:  # of a generator, a driver or a file: training is worth more than its pictures
            self._board.add_text(TAG, f"There is no picture, {describe(error)}.", pictures)

    def _sheet(self) -> UInt8[np.ndarray, "h w 3"]:
        model, generator, _ = load_checkpoint(self._checkpoint)
        model.config = replace(model.config, steps=min(model.config.steps, STEPS))
        self._pool = self._pool or BuildPool(generator.ref, 1, BUILD_S)
        renderer, inverter = Renderer(SIDE), Inverter(model, generator)
        self._photos = self._photos or list(_photos(self._data, generator, renderer))
        found = [inverter.estimate(photo, candidates=1) for photo in self._photos]
        built = self._pool.map([estimate.params for estimate in found], "light")
        tiles = [tile for pair in zip(found, built, strict=True) for tile in _pair(*pair, renderer)]
        renderer.close()
        return in_rows(tiles, 2)


def _photos(data: str | Path, generator: Generator, renderer: Renderer) -> Iterator[UInt8[np.ndarray, "s s 4"]]:
    rng = np.random.default_rng(0)
    built = ((sample.params, sample.mesh) for sample in Store(data).samples("validation") if sample.mesh)
    for params, mesh in islice(built, SHOWN):
        view, look = generator.seen_from(params).sample(rng), sample_look(rng, len(mesh.part_names))
        yield np.ascontiguousarray(renderer.render(mesh, view, look, MARGIN))


def _pair(estimate: Estimate, mesh: Mesh | BuildError, renderer: Renderer) -> list[UInt8[np.ndarray, "s s 3"]]:
    photo = over_white(prepare(estimate.image, SIDE)[0])
    if isinstance(mesh, BuildError):
        return [photo, np.full_like(photo, 128)]
    return [photo, over_white(renderer.render(mesh, estimate.view, margin=MARGIN))]
