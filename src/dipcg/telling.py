"""Training input of words: sentences about stored parameters, written while training, never twice the same."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch.utils.data import IterableDataset, get_worker_info

from dipcg.camera import VIEW_NUMBERS
from dipcg.captions import caption
from dipcg.dataset import Batch, Shapes
from dipcg.encoders.sentence import embed
from dipcg.generators import Generator


class Sentences(IterableDataset):
    """An endless stream of batches whose `images` are the tokens of sentences; no camera is told by words.

    Each batch of sentences is used `repeats` times: what is known of their parameters stays, the noise does not.
    """

    def __init__(self, generator: Generator, shapes: Shapes, batch: int, repeats: int = 1, seed: int = 0) -> None:
        self.generator, self.shapes, self.batch, self.repeats, self.seed = generator, shapes, batch, repeats, seed

    def __iter__(self) -> Iterator[Batch]:
        worker = get_worker_info()
        rng = np.random.default_rng([self.seed, worker.id if worker else 0])
        while True:
            told = self._tell(rng)
            for _ in range(self.repeats):
                yield told

    def _tell(self, rng: np.random.Generator) -> Batch:
        chosen = rng.integers(len(self.shapes.x), size=self.batch)
        params = [self.generator.space.decode(x.astype(float)) for x in self.shapes.x[chosen]]
        with torch.autocast("cpu", torch.bfloat16):
            words = embed([caption(self.generator, p, rng) for p in params])
        x = np.pad(self.shapes.x[chosen], ((0, 0), (0, VIEW_NUMBERS)))
        return Batch(words.clone(), torch.from_numpy(x), torch.from_numpy(self.shapes.active[chosen]))
