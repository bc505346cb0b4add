"""Training input for encoders of sentences: batches of captions of a data set's parameters, written during training."""

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
from dipcg.training.captions import caption_phrases, labelled_caption
from dipcg.training.pictures import Batch

# The number of encoded sentences in memory.
BUFFER = 4096
# The probability that the loss counts a parameter that the sentence does not describe, so that usual values are learnt.
UNDESCRIBED_PROBABILITY = 0.05
# The share of a batch that is composed of phrases which were encoded alone.
COMPOSED_FRACTION = 0.75
# The highest rate of token dropout. Each use of a sentence draws a rate below it, which reduces overfitting.
TOKEN_DROPOUT = 0.15


class Sentences:
    """Batches whose `images` are the tokens of sentences, and whose camera is zero because sentences have none.

    Encoding a sentence takes longer than a training step on it. Each sentence is therefore used about `repeats` times,
    and most of a batch is composed of phrases that were encoded alone, in a new combination each time. The parameters
    that count as active are those that the sentence describes, and a few others.
    """

    def __init__(self, generator: Generator, shapes: Shapes, batch: int, repeats: int = 1, seed: int = 0) -> None:
        self.generator, self.shapes, self.size, self.repeats, self.seed = generator, shapes, batch, repeats, seed
        self._encode_phrases = PhraseEncoder()
        self._buffer: Batch | None = None
        self._uses = 0

    def batch(self, step: int, size: int = 0) -> Batch:
        """The batch of a step: whole sentences from the buffer, and sentences that are composed of phrases."""
        rng = np.random.default_rng([self.seed, step])
        whole = max(1, round(self.size * (1 - COMPOSED_FRACTION)))
        buffer = self._refreshed_buffer(rng, self.size * self.repeats // whole)
        chosen = torch.from_numpy(rng.choice(len(buffer.x), whole, replace=False))
        both = _concatenate(Batch(*(part[chosen] for part in buffer)), self._composed(self.size - whole, rng))
        return both._replace(images=_drop_tokens(both.images.float(), rng))

    def close(self) -> None:
        """Do nothing: sentences hold no resource."""

    def _refreshed_buffer(self, rng: np.random.Generator, uses: int) -> Batch:
        """The buffer, which gets new sentences every `uses` calls, because encoding many at once is faster."""
        if self._buffer is None:
            self._buffer, self._uses = self._whole(self.size, rng), 0
        if self._uses % max(1, uses) == 0:
            self._buffer = _updated(self._buffer, self._whole(self.size, rng), rng)
        self._uses += 1
        return self._buffer

    def _whole(self, count: int, rng: np.random.Generator) -> Batch:
        """Captions of random shapes, each encoded as a whole sentence."""
        indices, params = self._draw_shapes(count, rng)
        captions = [labelled_caption(self.generator, one, rng) for one in params]
        tokens = embed([sentence for sentence, _ in captions], torch.bfloat16)
        return self._batch(indices, tokens, [names for _, names in captions], rng)

    def _composed(self, count: int, rng: np.random.Generator) -> Batch:
        """Captions of random shapes, each composed of phrases that were encoded alone."""
        indices, params = self._draw_shapes(count, rng)
        captions = [caption_phrases(self.generator, one, rng) for one in params]
        tokens = self._encode_phrases([phrases for phrases, _ in captions])
        return self._batch(indices, tokens, [names for _, names in captions], rng)

    def _draw_shapes(self, count: int, rng: np.random.Generator) -> tuple[Int64[np.ndarray, " n"], list[Params]]:
        """The indices and the parameters of random shapes."""
        indices = rng.integers(len(self.shapes.x), size=count)
        return indices, [self.generator.space.decode(x.astype(float)) for x in self.shapes.x[indices]]

    def _batch(
        self, indices: Int64[np.ndarray, " n"], tokens: Tensor, described: list[list[str]], rng: np.random.Generator
    ) -> Batch:
        """The batch of some shapes from the tokens of their captions and the names of the described parameters."""
        names = self.generator.space.names
        is_described = np.array([[name in row for name in names] for row in described], bool).reshape(-1, len(names))
        counted = is_described | (rng.random(is_described.shape) < UNDESCRIBED_PROBABILITY)
        x = np.pad(self.shapes.x[indices], ((0, 0), (0, VIEW_NUMBERS)))
        return Batch(tokens.half(), torch.from_numpy(x), torch.from_numpy(self.shapes.active[indices] & counted))


class PhraseEncoder:
    """The tokens of lists of phrases, where each phrase is encoded alone, and only once."""

    def __init__(self) -> None:
        self._tokens: dict[str, Tensor] = {}

    def __call__(self, lists: list[list[str]]) -> Float[Tensor, "b t c"]:
        """The concatenated tokens of each list of phrases, truncated and padded as `embed` does."""
        self._encode({phrase for phrases in lists for phrase in phrases} - self._tokens.keys())
        tokens = torch.zeros(len(lists), LENGTH, CHANNELS, dtype=torch.half)
        for row, phrases in zip(tokens, lists, strict=True):
            concatenated = torch.cat([self._tokens[phrase] for phrase in phrases])[:LENGTH]
            row[: len(concatenated)] = concatenated
        return tokens

    def _encode(self, new: set[str]) -> None:
        phrases = sorted(new)
        for phrase, tokens in zip(phrases, embed(phrases, torch.bfloat16), strict=True) if phrases else ():
            present = tokens[tokens.abs().sum(-1) > 0]
            # The start and the end token mark a whole sentence, and a phrase is a part of one.
            self._tokens[phrase] = present[1:-1].half()


def _concatenate(one: Batch, other: Batch) -> Batch:
    return Batch(*(torch.cat(both) for both in zip(one, other, strict=True)))


def _updated(buffer: Batch, new: Batch, rng: np.random.Generator) -> Batch:
    """The buffer with new sentences, which replace random ones when it is full."""
    if len(buffer.x) < BUFFER:
        return _concatenate(buffer, new)
    places = torch.from_numpy(rng.choice(len(buffer.x), len(new.x), replace=False))
    for old, added in zip(buffer, new, strict=True):
        old[places] = added
    return buffer


def _drop_tokens(tokens: Float[Tensor, "b t c"], rng: np.random.Generator) -> Float[Tensor, "b t c"]:
    """The tokens after token dropout: a random few of each sentence are zero, like padding."""
    kept = rng.random(tokens.shape[:2]) >= rng.uniform(0, TOKEN_DROPOUT, (len(tokens), 1))
    return tokens * torch.from_numpy(kept)[..., None]
