"""Training input of words: sentences about stored parameters, written while training, never twice the same."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS
from dipcg.data.shapes import Shapes
from dipcg.encoders.sentence import CHANNELS, LENGTH, embed
from dipcg.generators import Generator
from dipcg.space import Params
from dipcg.training.captions import pieces, tell
from dipcg.training.pictures import Batch

RECENT = 4096  # sentences kept for another use
UNSAID = 0.05  # share of what a sentence does not say that is asked for all the same, so that a usual value is learnt
COMPOSED = 0.75  # share of a batch that is put together from phrases
UNHEARD = 0.15  # share of tokens left out at most, others at each use: no sentence is to be learnt by heart


class Sentences:
    """Batches whose `images` are the tokens of sentences; words say nothing of the camera.

    Reading a sentence takes longer than learning from it, so each is used about `repeats` times, and most of a batch
    is made of phrases that were read alone, of which there are only some thousands, put together anew each time. A
    batch counts as active what the sentence says and a little of what it does not.
    """

    def __init__(self, generator: Generator, shapes: Shapes, batch: int, repeats: int = 1, seed: int = 0) -> None:
        self.generator, self.shapes, self.size, self.repeats, self.seed = generator, shapes, batch, repeats, seed
        self._read = Phrases()
        self._recent: Batch | None = None
        self._uses = 0

    def batch(self, step: int, size: int = 0) -> Batch:
        """The batch of a step, from sentences that were written in the steps before and from new ones."""
        rng = np.random.default_rng([self.seed, step])
        whole = max(1, round(self.size * (1 - COMPOSED)))
        recent = self._refreshed(rng, self.size * self.repeats // whole)
        chosen = torch.from_numpy(rng.choice(len(recent.x), whole, replace=False))
        both = _join(Batch(*(part[chosen] for part in recent)), self._compose(self.size - whole, rng))
        return both._replace(images=_partly_heard(both.images.float(), rng))

    def close(self) -> None:
        """Nothing is open."""

    def _refreshed(self, rng: np.random.Generator, uses: int) -> Batch:
        """The sentences to choose from; new ones join them after so many uses, many at once, which is faster."""
        if self._recent is None:
            self._recent, self._uses = self._tell(self.size, rng), 0
        if self._uses % max(1, uses) == 0:
            self._recent = _keep(self._recent, self._tell(self.size, rng), rng)
        self._uses += 1
        return self._recent

    def _tell(self, count: int, rng: np.random.Generator) -> Batch:
        """Whole sentences."""
        numbers, many = self._draw(count, rng)
        told = [tell(self.generator, params, rng) for params in many]
        words = embed([sentence for sentence, _ in told], torch.bfloat16)
        return self._batch(numbers, words, [names for _, names in told], rng)

    def _compose(self, count: int, rng: np.random.Generator) -> Batch:
        """Phrases one after the other."""
        numbers, many = self._draw(count, rng)
        told = [pieces(self.generator, params, rng) for params in many]
        return self._batch(numbers, self._read([phrases for phrases, _ in told]), [names for _, names in told], rng)

    def _draw(self, count: int, rng: np.random.Generator) -> tuple[Int64[np.ndarray, " n"], list[Params]]:
        """Numbers of some shapes, and their parameters."""
        numbers = rng.integers(len(self.shapes.x), size=count)
        return numbers, [self.generator.space.decode(x.astype(float)) for x in self.shapes.x[numbers]]

    def _batch(
        self, numbers: Int64[np.ndarray, " n"], words: Tensor, names: list[list[str]], rng: np.random.Generator
    ) -> Batch:
        every = self.generator.space.names
        said = np.array([name in told for told in names for name in every], bool).reshape(len(names), len(every))
        wanted = self.shapes.active[numbers] & (said | (rng.random(said.shape) < UNSAID))
        x = np.pad(self.shapes.x[numbers], ((0, 0), (0, VIEW_NUMBERS)))
        return Batch(words.half(), torch.from_numpy(x), torch.from_numpy(wanted))


class Phrases:
    """Tokens of phrases that are read alone, and once."""

    def __init__(self) -> None:
        self._known: dict[str, Tensor] = {}

    def __call__(self, many: list[list[str]]) -> Float[Tensor, "b t c"]:
        """The tokens of some phrases each, one after the other, cut and filled up as a sentence's are."""
        self._read({phrase for phrases in many for phrase in phrases} - self._known.keys())
        words = torch.zeros(len(many), LENGTH, CHANNELS, dtype=torch.half)
        for row, phrases in zip(words, many, strict=True):
            found = torch.cat([self._known[phrase] for phrase in phrases])[:LENGTH]
            row[: len(found)] = found
        return words

    def _read(self, new: set[str]) -> None:
        phrases = sorted(new)
        for phrase, words in zip(phrases, embed(phrases, torch.bfloat16), strict=True) if phrases else ():
            there = words[words.abs().sum(-1) > 0]
            self._known[phrase] = there[1:-1].half()  # without the marks of a sentence's ends


def _join(one: Batch, other: Batch) -> Batch:
    return Batch(*(torch.cat(both) for both in zip(one, other, strict=True)))


def _keep(recent: Batch, new: Batch, rng: np.random.Generator) -> Batch:
    """The recent sentences and the new ones, which take the places of others once there are `RECENT`."""
    if len(recent.x) < RECENT:
        return _join(recent, new)
    places = torch.from_numpy(rng.choice(len(recent.x), len(new.x), replace=False))
    for old, added in zip(recent, new, strict=True):
        old[places] = added
    return recent


def _partly_heard(words: Float[Tensor, "b t c"], rng: np.random.Generator) -> Float[Tensor, "b t c"]:
    """The tokens with a random few of each sentence at zero, as if they were not there."""
    heard = rng.random(words.shape[:2]) >= rng.uniform(0, UNHEARD, (len(words), 1))
    return words * torch.from_numpy(heard)[..., None]
