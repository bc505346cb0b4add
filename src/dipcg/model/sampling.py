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
from dipcg.model.denoiser import Condition, Outputs, Prediction
from dipcg.model.estimators import AnyEstimator, PaperEstimator

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
    model: AnyEstimator,
    condition: Condition,
    noise: Float[Tensor, "b d"],
    steps: int = 10,
    sampler: str = "euler",
    known: Float[Tensor, "b d"] | None = None,
    given: Bool[Tensor, "b d"] | None = None,
    views: int = 1,
) -> Prediction:
    """Draw from the model: one clean `x` for each row of noise, the entries `given` held at `known`.

    With several `views` of one object the rows are of the first picture, then of the second and so on: their parameters
    start alike and stay alike, since each step goes to what all pictures together expect; each has its own camera.

    The last prediction is returned whole, so that a choice can be read from its category and not from an average.
    The paper's model has its own sampler and takes no other.
    """
    given = torch.zeros_like(noise, dtype=torch.bool) if given is None else given
    known = torch.zeros_like(noise) if known is None else known
    if isinstance(model, PaperEstimator):
        return model.sample(condition, noise, steps, known, given)
    last: list[Prediction] = []

    def predict(x: Tensor, t: Tensor) -> Tensor:
        prediction = model.denoiser(torch.where(given, known, x), t.expand(len(x)), given, condition)
        prediction = agreed(model.outputs, prediction, views) if views > 1 else prediction
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
