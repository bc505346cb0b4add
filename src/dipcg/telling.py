"""Training input of words: sentences about stored parameters, written while training, never twice the same."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch.utils.data import IterableDataset, get_worker_info

from dipcg.camera import VIEW_NUMBERS
from dipcg.captions import tell
from dipcg.dataset import Batch, Shapes
from dipcg.encoders.sentence import embed
from dipcg.generators import Generator

RECENT = 2048  # sentences kept for another use
UNSAID = 0.15  # share of what a sentence does not say that is asked for all the same, so that a usual value is learnt


class Sentences(IterableDataset):
    """An endless stream of batches whose `images` are the tokens of sentences; no camera is told by words.

    Reading a sentence takes longer than learning from it, so each is used about `repeats` times, beside others. A
    batch counts as active what the sentence says and a little of what it does not.
    """

    def __init__(self, generator: Generator, shapes: Shapes, batch: int, repeats: int = 1, seed: int = 0) -> None:
        self.generator, self.shapes, self.batch, self.repeats, self.seed = generator, shapes, batch, repeats, seed

    def __iter__(self) -> Iterator[Batch]:
        worker = get_worker_info()
        rng = np.random.default_rng([self.seed, worker.id if worker else 0])
        recent = self._tell(self.batch, rng)
        while True:
            recent = _keep(recent, self._tell(self.batch, rng), rng)  # many at once: the fewer, the longer each takes
            for _ in range(self.repeats):
                chosen = torch.from_numpy(rng.choice(len(recent.x), self.batch, replace=False))
                words, x, wanted = (part[chosen] for part in recent)
                yield Batch(words.float(), x, wanted)

    def _tell(self, count: int, rng: np.random.Generator) -> Batch:
        space, chosen = self.generator.space, rng.integers(len(self.shapes.x), size=count)
        told = [tell(self.generator, space.decode(x.astype(float)), rng) for x in self.shapes.x[chosen]]
        words = embed([sentence for sentence, _ in told], torch.bfloat16)
        said = np.array([[name in names for name in space.names] for _, names in told])
        wanted = self.shapes.active[chosen] & (said | (rng.random(said.shape) < UNSAID))
        x = np.pad(self.shapes.x[chosen], ((0, 0), (0, VIEW_NUMBERS)))
        return Batch(words.half(), torch.from_numpy(x), torch.from_numpy(wanted))


def _keep(recent: Batch, new: Batch, rng: np.random.Generator) -> Batch:
    """The recent sentences and the new ones, which take the places of others once there are `RECENT`."""
    if len(recent.x) < RECENT:
        return Batch(*(torch.cat(both) for both in zip(recent, new, strict=True)))
    places = torch.from_numpy(rng.choice(len(recent.x), len(new.x), replace=False))
    for old, added in zip(recent, new, strict=True):
        old[places] = added
    return recent
