"""Fitting the classifier that says which generator makes what a picture shows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int64
from torch import Tensor, nn

from dipcg.data.shapes import load_shapes
from dipcg.inference.classifier import Kinds, fingerprint
from dipcg.pipeline import Inverter
from dipcg.training.pictures import SLOTS, Pictures

BATCH, STEPS = 64, 400


def fit(inverter: Inverter, folders: Sequence[str | Path], pictures: int = 1500, split: str = "train") -> Kinds:
    """Fit a classifier on so many augmented pictures of each data set, by cross-entropy.

    Raises ValueError for fewer than two data sets or an unusable one.
    """
    if len(folders) < 2:
        raise ValueError(f"To tell kinds apart takes data sets of two generators or more, got {len(folders)}.")
    seen = [summaries(inverter, folder, pictures, split) for folder in folders]
    names = tuple(name for name, _ in seen)
    summary, kind = torch.cat([found for _, found in seen]), torch.arange(len(seen)).repeat_interleave(pictures)
    return fitted(names, fingerprint(inverter), summary, kind)


@torch.inference_mode()
def summaries(inverter: Inverter, folder: str | Path, count: int, split: str) -> tuple[str, Float[Tensor, "n w"]]:
    """A data set's generator, and what the encoder makes of pictures of its shapes."""
    generator, shapes = load_shapes(folder, split)
    pictures, size = Pictures(generator, shapes, BATCH, seed=7, slots=min(count, SLOTS)), inverter.image_size
    found = [inverter.model.encoder(pictures.batch(i, size).images).summary for i in range(-(-count // BATCH))]
    pictures.close()
    return generator.name, torch.cat(found)[:count].clone()


def fitted(names: tuple[str, ...], encoder: str, summary: Float[Tensor, "n w"], kind: Int64[Tensor, " n"]) -> Kinds:
    """A classifier of summaries whose kinds are numbered in the order of the names, by cross-entropy."""
    layer = nn.Linear(summary.shape[1], len(names))
    optimiser = torch.optim.AdamW(layer.parameters(), 1e-2, weight_decay=0.1)
    for _ in range(STEPS):
        chosen = torch.randint(len(summary), (512,))
        loss = F.cross_entropy(layer(summary[chosen]), kind[chosen], label_smoothing=0.02)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return Kinds(names, encoder, layer.weight.detach(), layer.bias.detach())
