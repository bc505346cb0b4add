"""How far estimates are from the truth in parameters: what training watches."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS
from dipcg.dataset import Batch
from dipcg.denoiser import Estimator
from dipcg.sampling import sample


@dataclass(frozen=True)
class Validation:
    """Mean absolute error in x of active reals, and share of active choices right, of the guess and of one sample."""

    guess_reals: float
    guess_choices: float
    sample_reals: float
    sample_choices: float

    @property
    def score(self) -> float:
        """What the best weights have lowest: errors of the sample, with the guess as its floor."""
        return self.sample_reals + self.guess_reals + 2 - self.sample_choices - self.guess_choices


@torch.no_grad()
def validate(model: Estimator, batch: Batch, seed: int = 0) -> Validation:
    """Compare the direct guess and one sample per picture with the truth."""
    model.eval()
    features = model.encoder(batch.images.float() / 255)
    guess = model.outputs.modes(model.first_guess(features))
    noise = torch.randn(batch.x.shape, generator=torch.Generator().manual_seed(seed)).to(batch.x)
    drawn = model.outputs.modes(sample(model, model.condition(features), noise))
    return Validation(*_errors(model, guess, batch), *_errors(model, drawn, batch))


def _errors(model: Estimator, x: Float[Tensor, "b d"], batch: Batch) -> tuple[float, float]:
    off = (x - batch.x).abs()[:, :-VIEW_NUMBERS]
    chosen = model.outputs.is_choice[:-VIEW_NUMBERS]
    return _mean(off, batch.active & ~chosen), _mean((off < 1e-3).float(), batch.active & chosen)


def _mean(values: Float[Tensor, "b p"], where: Bool[Tensor, "b p"]) -> float:
    return float(values[where].mean()) if where.any() else 0.0
