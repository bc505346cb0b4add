"""What a network says about several pictures at once: the expected `x`, and draws, around values that are fixed.

Shapes: `b` pictures, or objects that `views` pictures each show; `n` draws of each; `d` entries of `x`. The rows of the
condition are those of all objects seen first, then of all objects as the second picture shows them, and so on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dipcg.model.constraints import Fixed
from dipcg.model.denoiser import Condition, Prediction
from dipcg.model.estimators import AnyEstimator


@dataclass(frozen=True)
class Posterior:
    """The distribution of `x` for each of `count` objects, given `views` pictures of each."""

    model: AnyEstimator
    condition: Condition
    count: int
    views: int = 1

    def of(self, index: int) -> Posterior:
        """The distribution for one of the objects."""
        rows, one = slice(index, None, self.count), self.condition
        pairs = [(keys[rows], values[rows]) for keys, values in one.keys_values]
        return replace(self, condition=Condition(pairs, one.summary[rows], one.guess[rows]), count=1)

    def expect(self, noise: Float[Tensor, "b n d"], fixed: Fixed) -> Prediction:
        """The mean of reals and the probabilities of choices: what the denoiser expects before its first step.

        One row for each object. It is nearer to the truth on average than a sample, which also draws what the picture
        leaves open.
        """
        first = self.draw(noise, self.model.config.expecting_steps, fixed)
        shares = self.model.outputs.log_probabilities(first.logits).exp()
        mean, shares = (rows.unflatten(0, noise.shape[:2]).mean(1) for rows in (first.mean, shares))
        return Prediction(mean, shares.log())

    def draw(self, noise: Float[Tensor, "b n d"], steps: int, fixed: Fixed) -> Prediction:
        """A draw for each row of noise, those of an object next to each other."""
        draws = noise.shape[1]
        values, mask = (part.repeat_interleave(draws, 0).repeat(self.views, 1) for part in fixed)
        rows = noise.flatten(0, 1).repeat(self.views, 1)
        drawn = self.model.sample(self.condition.repeat(draws), rows, steps, values, mask, self.views)
        return Prediction(drawn.mean[: self.count * draws], drawn.logits[: self.count * draws])

    def modes(self, prediction: Prediction, fixed: Fixed) -> Float[np.ndarray, "b_n d"]:
        """The likeliest `x` of each row of a prediction, with the fixed values of its object."""
        values, mask = (part.repeat_interleave(len(prediction.mean) // self.count, 0) for part in fixed)
        return torch.where(mask, values, self.model.outputs.modes(prediction)).double().numpy()
