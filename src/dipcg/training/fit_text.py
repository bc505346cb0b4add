"""Fitting the classifier that says which generator a sentence describes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from dipcg.generators import Generator, load_generator
from dipcg.inference.classifier import Kinds
from dipcg.inference.recognise_text import ENCODER, summaries
from dipcg.training.captions import caption
from dipcg.training.fit import fitted

NAMED = 0.6  # share of captions that say what the thing is called
NAMELESS = ("one", "thing", "object", "piece", "it", "design", "model")
AT_ONCE = 100  # sentences that are read together


def fit(names: Sequence[str], sentences: int = 1500, seed: int = 0) -> Kinds:
    """Fit the classifier on so many captions of random assets of each generator."""
    rng = np.random.default_rng(seed)
    told = [text for name in names for text in captions(load_generator(name), sentences, rng)]
    read = torch.cat([summaries(told[i : i + AT_ONCE]) for i in range(0, len(told), AT_ONCE)])
    return fitted(tuple(names), ENCODER, read, torch.arange(len(names)).repeat_interleave(sentences))


def captions(generator: Generator, count: int, rng: np.random.Generator) -> list[str]:
    """Sentences about random assets, some of which do not say what the thing is."""
    return [
        caption(generator, generator.space.sample(rng), rng, None if rng.random() < NAMED else NAMELESS)
        for _ in range(count)
    ]
