"""Fitting the classifier that says which generator makes what a picture shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int64
from torch import Tensor, nn

from dipcg.data.shapes import load_shapes
from dipcg.inference.classifier import Classifier, fingerprint
from dipcg.pipeline import Inverter
from dipcg.training.pictures import SLOTS, Pictures

BATCH, STEPS = 64, 400


def fit(inverter: Inverter, folders: Sequence[str | Path], pictures: int = 1500, split: str = "train") -> Classifier:
    """Fit a classifier on so many augmented pictures of each data set, by cross-entropy.

    Raises ValueError for fewer than two data sets or an unusable one.
    """
    if len(folders) < 2:
        raise ValueError(f"A classifier needs data sets of two generators or more, got {len(folders)}.")
    seen = [summaries(inverter, folder, pictures, split) for folder in folders]
    names = tuple(name for name, _ in seen)
    summary = torch.cat([found for _, found in seen])
    return fitted(names, fingerprint(inverter), summary, torch.arange(len(seen)).repeat_interleave(pictures))


@torch.inference_mode()
def summaries(inverter: Inverter, folder: str | Path, count: int, split: str) -> tuple[str, Float[Tensor, "n w"]]:
    """A data set's generator, and what the encoder makes of pictures of its shapes."""
    generator, shapes = load_shapes(folder, split)
    pictures, size = Pictures(generator, shapes, BATCH, seed=7, slots=min(count, SLOTS)), inverter.image_size
    found = [inverter.model.encoder(pictures.batch(i, size).images).summary for i in range(-(-count // BATCH))]
    pictures.close()
    return generator.name, torch.cat(found)[:count].clone()


def fitted(
    names: tuple[str, ...], encoder: str, summary: Float[Tensor, "n w"], label: Int64[Tensor, " n"], seed: int = 0
) -> Classifier:
    """A classifier of summaries, fitted by cross-entropy; labels are positions in `names`, `seed` draws the batches."""
    layer, rng = nn.Linear(summary.shape[1], len(names)), torch.Generator().manual_seed(seed)
    # The loss of a linear classifier is convex, so it may start anywhere.
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)
    optimiser = torch.optim.AdamW(layer.parameters(), 1e-2, weight_decay=0.1)
    for _ in range(STEPS):
        chosen = torch.randint(len(summary), (512,), generator=rng)
        loss = F.cross_entropy(layer(summary[chosen]), label[chosen], label_smoothing=0.02)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return Classifier(names, encoder, layer.weight.detach(), layer.bias.detach())
