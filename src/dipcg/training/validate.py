"""How far estimates are from the truth in parameters: what training watches."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS
from dipcg.config import TrainConfig
from dipcg.encoders import Features
from dipcg.model.estimators import AnyEstimator
from dipcg.training.pictures import Batch

# The most steps of the sampler: the paper's model takes 250 for an estimate, which a validation cannot wait for.
MOST_STEPS = 25
# Pictures of which a sample is drawn, which takes much longer than a guess.
SAMPLED = 128
# One noise level per picture, and nothing fixed.
PLAIN = TrainConfig(draws=1, lock=0.0, pure_noise_fraction=0.0)


@dataclass(frozen=True)
class Validation:
    """Mean absolute error in x of active reals, and share of active choices right, of the guess and of one sample.

    The paper's model makes no guess, and while the encoder is trained by its guess there is no sample.
    """

    guess_reals: float | None
    guess_choices: float | None
    sample_reals: float | None
    sample_choices: float | None
    loss: float
    """what the present stage of training makes small, on these pictures at fixed noise"""


@torch.no_grad()
def validate(model: AnyEstimator, batch: Batch, denoiser: bool = True, seed: int = 0) -> Validation:
    """Compare the direct guess, and with `denoiser` one sample per picture, with the truth."""
    model.eval()
    features = model.encoder(batch.images.float())
    guess, sample_errors, loss = (None, None), (None, None), 0.0
    if model.makes_guess:
        guess = _errors(model, model.outputs.modes(model.first_guess(features)), batch)
        loss = float(model.guess_loss(features, batch.x, batch.active))
    if denoiser:
        few = Batch(*(part[:SAMPLED] for part in batch))
        some = Features(*(part[:SAMPLED] for part in features))
        sample_errors, loss = _sampled(model, some, few, seed), _denoising_loss(model, some, few, seed)
    return Validation(*guess, *sample_errors, loss)


def _sampled(model: AnyEstimator, features: Features, batch: Batch, seed: int) -> tuple[float, float]:
    noise = torch.randn(batch.x.shape, generator=torch.Generator().manual_seed(seed)).to(batch.x)
    steps = min(model.config.steps, MOST_STEPS)
    return _errors(model, model.outputs.modes(model.sample(model.condition(features), noise, steps)), batch)


def _denoising_loss(model: AnyEstimator, features: Features, batch: Batch, seed: int) -> float:
    with torch.random.fork_rng(devices=[batch.x.device] if batch.x.is_cuda else []):
        torch.manual_seed(seed)
        return float(model.denoising_loss(features, batch.x, batch.active, PLAIN))


def _errors(model: AnyEstimator, x: Float[Tensor, "b d"], batch: Batch) -> tuple[float, float]:
    off = (x - batch.x).abs()[:, :-VIEW_NUMBERS]
    chosen = model.outputs.is_choice[:-VIEW_NUMBERS]
    return _mean(off, batch.active & ~chosen), _mean((off < 1e-3).float(), batch.active & chosen)


def _mean(values: Float[Tensor, "b p"], where: Bool[Tensor, "b p"]) -> float:
    return float(values[where].mean()) if where.any() else 0.0


def resized(images: Tensor, size: int) -> Tensor:
    """Pictures at another size; tokens of sentences as they are."""
    if images.ndim != 4 or images.shape[-1] == size:
        return images
    return F.interpolate(images.float(), (size, size), mode="bilinear", antialias=True)
