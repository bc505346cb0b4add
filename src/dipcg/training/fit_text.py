"""Fitting the classifier that says which generator a sentence describes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from dipcg.generators import Generator, load_generator
from dipcg.inference.classifier import Classifier
from dipcg.inference.recognise_text import ENCODER, summaries
from dipcg.training.captions import caption
from dipcg.training.fit import fitted

# Share of captions that name the object, and what the others call it.
NAMED = 0.6
NAMELESS = ("one", "thing", "object", "piece", "it", "design", "model")
# Sentences that are encoded together.
BATCH = 100


def fit(names: Sequence[str], sentences: int = 1500, seed: int = 0) -> Classifier:
    """Fit the classifier on so many captions of random assets of each generator."""
    rng = np.random.default_rng(seed)
    texts = [text for name in names for text in captions(load_generator(name), sentences, rng)]
    summary = torch.cat([summaries(texts[i : i + BATCH]) for i in range(0, len(texts), BATCH)])
    return fitted(tuple(names), ENCODER, summary, torch.arange(len(names)).repeat_interleave(sentences), seed)


def captions(generator: Generator, count: int, rng: np.random.Generator) -> list[str]:
    """Sentences about random assets, some of which do not name the object."""
    return [
        caption(generator, generator.space.sample(rng), rng, None if rng.random() < NAMED else NAMELESS)
        for _ in range(count)
    ]
