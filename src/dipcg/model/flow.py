"""Flow matching that predicts the clean end: the path from noise to `x`, and the loss on the way.

Sources: Lipman et al. 2023 (the straight path), Karras et al. 2022 (predicting the clean end).
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS
from dipcg.model.denoiser import Condition, Denoiser, Outputs, Prediction


def interpolate(x: Float[Tensor, "b d"], noise: Float[Tensor, "b d"], t: Float[Tensor, " b"]) -> Float[Tensor, "b d"]:
    """The point at time `t` of the straight path from noise (0) to clean (1)."""
    return torch.lerp(noise, x, t[:, None])


def prediction_loss(
    outputs: Outputs, prediction: Prediction, x: Float[Tensor, "b d"], wanted: Bool[Tensor, "b d"]
) -> Float[Tensor, ""]:
    """Squared error of reals plus cross-entropy of choices, over the wanted entries alone."""
    # A third is the variance of a uniform parameter.
    squared = (prediction.mean - x).square() * 3
    surprise = -(outputs.log_probabilities(prediction.logits) * outputs.choice_targets(x))
    per_choice = torch.zeros_like(x).index_add_(1, outputs.owner, surprise)
    per_entry = torch.where(outputs.is_choice, per_choice, squared)
    return (per_entry * wanted).sum() / wanted.sum().clamp_min(1)


def denoising_loss(
    denoiser: Denoiser,
    condition: Condition,
    x: Float[Tensor, "b d"],
    active: Bool[Tensor, "b d"],
    lock: float,
    pure_noise_fraction: float = 0.0,
) -> Float[Tensor, ""]:
    """The loss at one random time per row, with some parameters fixed at their true values in a share `lock` of rows.

    A share `pure_noise_fraction` of the rows is at time 0, where the expectation is read and which random times seldom
    come near. An inactive parameter has no meaning: the network sees a random value there, and no loss counts it.
    """
    x = torch.where(active, x, torch.rand_like(x) * 2 - 1)
    # The square root prefers late times, which decide the details.
    t = torch.rand(len(x), device=x.device).sqrt()
    t = t * (torch.rand_like(t) >= pure_noise_fraction)
    fixed_mask = _random_mask(x, lock)
    noisy = torch.where(fixed_mask, x, interpolate(x, torch.randn_like(x), t))
    prediction = denoiser(noisy, t, fixed_mask, condition)
    return prediction_loss(denoiser.outputs, prediction, x, active & ~fixed_mask)


def with_view(active: Bool[Tensor, "b p"]) -> Bool[Tensor, "b d"]:
    """Activity of the parameters extended by the camera's entries, which always count."""
    return F.pad(active, (0, VIEW_NUMBERS), value=True)


def _random_mask(x: Tensor, lock: float) -> Bool[Tensor, "b d"]:
    share = torch.rand(len(x), 1, device=x.device) * (torch.rand(len(x), 1, device=x.device) < lock)
    return torch.rand_like(x) < share
