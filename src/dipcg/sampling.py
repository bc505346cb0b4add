"""From noise to `x`: plain functions with one signature, as in k-diffusion.

Each takes a `predict(x, t)` that gives the clean end expected from `x` at time `t`, a start and rising times in [0, 1].
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dipcg.denoiser import Condition, Estimator, Prediction

Predict = Callable[[Tensor, Tensor], Tensor]


def euler(predict: Predict, x: Float[Tensor, "b d"], times: Float[Tensor, " s"]) -> Float[Tensor, "b d"]:
    """First order: straight towards the expected end, step by step."""
    for now, then in pairwise(times):
        x = torch.lerp(x, predict(x, now), (then - now) / (1 - now))
    return x


def heun(predict: Predict, x: Float[Tensor, "b d"], times: Float[Tensor, " s"]) -> Float[Tensor, "b d"]:
    """Second order (Karras et al. 2022, algorithm 1): two predictions a step but for the last."""
    for now, then in pairwise(times):
        slope = (predict(x, now) - x) / (1 - now)
        ahead = x + (then - now) * slope
        if then < 1:
            slope = (slope + (predict(ahead, then) - ahead) / (1 - then)) / 2
        x = x + (then - now) * slope
    return x


SAMPLERS = {"euler": euler, "heun": heun}


def sample(
    model: Estimator,
    condition: Condition,
    noise: Float[Tensor, "b d"],
    steps: int = 10,
    sampler: str = "euler",
    known: Float[Tensor, "b d"] | None = None,
    given: Bool[Tensor, "b d"] | None = None,
) -> Prediction:
    """Draw from the model: one clean `x` for each row of noise, the entries `given` held at `known`.

    The last prediction is returned whole, so that a choice can be read from its category and not from an average.
    """
    given = torch.zeros_like(noise, dtype=torch.bool) if given is None else given
    known = torch.zeros_like(noise) if known is None else known
    last: list[Prediction] = []

    def predict(x: Tensor, t: Tensor) -> Tensor:
        prediction = model.denoiser(torch.where(given, known, x), t.expand(len(x)), given, condition)
        last[:] = [prediction]
        return prediction.mean

    SAMPLERS[sampler](predict, noise, torch.linspace(0, 1, steps + 1, device=noise.device))
    return last[0]
