"""How far estimates are from the truth in parameters: what training watches."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS
from dipcg.encoders import Features
from dipcg.model.estimators import AnyEstimator, PaperEstimator
from dipcg.model.flow import denoising_loss, guess_loss, with_view
from dipcg.model.sampling import sample
from dipcg.training.pictures import Batch, encoder_input

PAPER_STEPS = 25  # for one sample of the paper's model, a tenth of what an estimate takes


@dataclass(frozen=True)
class Validation:
    """Mean absolute error in x of active reals, and share of active choices right, of the guess and of one sample.

    The paper's model makes no guess.
    """

    guess_reals: float | None
    guess_choices: float | None
    sample_reals: float
    sample_choices: float
    loss: float
    """of training, guess and denoiser, on these pictures: what the best weights have lowest"""


@torch.no_grad()
def validate(model: AnyEstimator, batch: Batch, seed: int = 0) -> Validation:
    """Compare the direct guess and one sample per picture with the truth, and give the loss at fixed noise."""
    model.eval()
    features = model.encoder(encoder_input(batch.images))
    paper = isinstance(model, PaperEstimator)
    guess = (None, None) if paper else _errors(model, model.outputs.modes(model.first_guess(features)), batch)
    noise = torch.randn(batch.x.shape, generator=torch.Generator().manual_seed(seed)).to(batch.x)
    steps = PAPER_STEPS if paper else model.config.steps
    drawn = model.outputs.modes(sample(model, model.condition(features), noise, steps))
    return Validation(*guess, *_errors(model, drawn, batch), _loss(model, features, batch, seed))


def _loss(model: AnyEstimator, features: Features, batch: Batch, seed: int) -> float:
    active = with_view(batch.active)
    with torch.random.fork_rng(devices=[batch.x.device] if batch.x.is_cuda else []):
        torch.manual_seed(seed)
        if isinstance(model, PaperEstimator):
            return float(model.loss(features, batch.x))
        denoising = denoising_loss(model, model.condition(features), batch.x, active, lock=0.0)
    return float(guess_loss(model, model.first_guess(features), batch.x, active) + denoising)


def _errors(model: AnyEstimator, x: Float[Tensor, "b d"], batch: Batch) -> tuple[float, float]:
    off = (x - batch.x).abs()[:, :-VIEW_NUMBERS]
    chosen = model.outputs.is_choice[:-VIEW_NUMBERS]
    return _mean(off, batch.active & ~chosen), _mean((off < 1e-3).float(), batch.active & chosen)


def _mean(values: Float[Tensor, "b p"], where: Bool[Tensor, "b p"]) -> float:
    return float(values[where].mean()) if where.any() else 0.0
