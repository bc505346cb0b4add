"""Flow matching that predicts the clean end: the path from noise to `x`, and the loss on the way.

Sources: Lipman et al. 2023 (the straight path), Karras et al. 2022 (predicting the clean end).
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS
from dipcg.model.denoiser import Condition, Outputs, Prediction
from dipcg.model.estimators import Estimator


def interpolate(x: Float[Tensor, "b d"], noise: Float[Tensor, "b d"], t: Float[Tensor, " b"]) -> Float[Tensor, "b d"]:
    """The point at time `t` of the straight path from noise (0) to clean (1)."""
    return torch.lerp(noise, x, t[:, None])


def prediction_loss(
    outputs: Outputs, prediction: Prediction, x: Float[Tensor, "b d"], wanted: Bool[Tensor, "b d"]
) -> Float[Tensor, ""]:
    """Squared error of reals plus cross-entropy of choices, over the wanted entries alone."""
    squared = (prediction.mean - x).square() * 3  # a third is the variance of a uniform parameter
    surprise = -(outputs.log_probabilities(prediction.logits) * outputs.choice_targets(x))
    per_choice = torch.zeros_like(x).index_add_(1, outputs.owner, surprise)
    per_entry = torch.where(outputs.is_choice, per_choice, squared)
    return (per_entry * wanted).sum() / wanted.sum().clamp_min(1)


def denoising_loss(
    model: Estimator,
    condition: Condition,
    x: Float[Tensor, "b d"],
    active: Bool[Tensor, "b d"],
    lock: float,
    first: float = 0.0,
) -> Float[Tensor, ""]:
    """The loss at one random time per row, with some parameters given clean in a share `lock` of the rows.

    A share `first` of the rows is at time 0, which random times seldom come near and the expectation is read at.

    An inactive parameter means nothing, so the network sees a random value there and is not asked for it.
    """
    x = torch.where(active, x, torch.rand_like(x) * 2 - 1)
    t = torch.rand(len(x), device=x.device).sqrt()  # late times decide the details
    t = t * (torch.rand_like(t) >= first)
    given = _random_locks(x, lock)
    noisy = torch.where(given, x, interpolate(x, torch.randn_like(x), t))
    return prediction_loss(model.outputs, model.denoiser(noisy, t, given, condition), x, active & ~given)


def guess_loss(
    model: Estimator, guess: Prediction, x: Float[Tensor, "b d"], active: Bool[Tensor, "b d"]
) -> Float[Tensor, ""]:
    """The loss of the direct regression from the picture's summary."""
    return prediction_loss(model.outputs, guess, x, active)


def with_view(active: Bool[Tensor, "b p"]) -> Bool[Tensor, "b d"]:
    """Activity of the parameters extended by the camera's entries, which always count."""
    return F.pad(active, (0, VIEW_NUMBERS), value=True)


def _random_locks(x: Tensor, lock: float) -> Bool[Tensor, "b d"]:
    share = torch.rand(len(x), 1, device=x.device) * (torch.rand(len(x), 1, device=x.device) < lock)
    return torch.rand_like(x) < share
