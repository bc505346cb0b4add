"""From noise to `x`: plain functions with one signature, as in k-diffusion.

Each takes a `predict(x, t)` that gives the clean end expected from `x` at time `t`, a start and rising times in [0, 1].
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS
from dipcg.model.denoiser import Condition, Denoiser, Outputs, Prediction

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
    denoiser: Denoiser,
    condition: Condition,
    noise: Float[Tensor, "b d"],
    steps: int,
    fixed: Float[Tensor, "b d"],
    fixed_mask: Bool[Tensor, "b d"],
    views: int = 1,
    sampler: str = "euler",
) -> Prediction:
    """Draw one clean `x` for each row of noise; the entries under `fixed_mask` have their `fixed` values throughout.

    With several `views` of one object the rows are of the first picture, then of the second and so on: their parameters
    start alike and stay alike, since each step goes to what all pictures together expect; each has its own camera.

    The last prediction is returned whole, so that a choice can be read from its category and not from an average.
    """
    last: list[Prediction] = []

    def predict(x: Tensor, t: Tensor) -> Tensor:
        prediction = denoiser(torch.where(fixed_mask, fixed, x), t.expand(len(x)), fixed_mask, condition)
        prediction = agreed(denoiser.outputs, prediction, views) if views > 1 else prediction
        last[:] = [prediction]
        return prediction.mean

    SAMPLERS[sampler](predict, noise, torch.linspace(0, 1, steps + 1, device=noise.device))
    return last[0]


def agreed(outputs: Outputs, prediction: Prediction, views: int) -> Prediction:
    """One prediction for all views: the mean of reals, the product of the choices' probabilities; cameras stay apart.

    The product is right when what one picture tells does not depend on what another does, given the object.
    """
    logits = outputs.log_probabilities(prediction.logits).unflatten(0, (views, -1)).sum(0)
    mean = prediction.mean.unflatten(0, (views, -1)).mean(0)
    mean = torch.where(outputs.is_choice, outputs.expect(logits), mean).repeat(views, 1)
    mean = torch.cat([mean[:, :-VIEW_NUMBERS], prediction.mean[:, -VIEW_NUMBERS:]], 1)
    return Prediction(mean, logits.repeat(views, 1))
