"""From a configuration to a network: ours, or the paper's under the same interface.

`makes_guess` says whether an estimator has a direct guess, `first_guess`, which is trained by `guess_loss` before the
denoiser is by `denoising_loss`. Without one, `denoising_loss` trains the encoder too.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from dipcg.camera import VIEW_NUMBERS, View, encode_view
from dipcg.config import ModelConfig, TrainConfig
from dipcg.encoders import Features, build_encoder
from dipcg.model import ddpm, flow, sampling
from dipcg.model.denoiser import Condition, Denoiser, Outputs, Prediction
from dipcg.model.dit import DiT
from dipcg.space import ParameterSpace

# The paper's model says nothing of the camera; this is the middle of its views.
UNSEEN_VIEW = View(30.0, 30.0, 2.0)
NO_GUESS = "The paper's recipe has no direct guess; ask for an estimate, or train without --recipe."


class Estimator(nn.Module):
    """From pictures to parameters and camera, for one parameter space."""

    makes_guess = True

    def __init__(self, space: ParameterSpace, config: ModelConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder = build_encoder(config)
        self.outputs = Outputs(space)
        self.guess = nn.Linear(config.summary, self.outputs.numbers)
        self.denoiser = Denoiser(self.outputs, config, self.encoder.channels)  # type: ignore[arg-type]

    def first_guess(self, features: Features) -> Prediction:
        """Direct regression from the summary: the cheap baseline, and the denoiser's starting point."""
        return self.outputs(self.guess(features.summary))

    def condition(self, features: Features) -> Condition:
        """What the denoiser attends to; the guess is not trained through it."""
        return self.denoiser.condition(features, self.guess(features.summary).detach())

    def sample(
        self,
        condition: Condition,
        noise: Float[Tensor, "b d"],
        steps: int,
        fixed: Float[Tensor, "b d"] | None = None,
        fixed_mask: Bool[Tensor, "b d"] | None = None,
        views: int = 1,
    ) -> Prediction:
        """One draw for each row of noise; see `sampling.sample`."""
        return sampling.sample(self.denoiser, condition, noise, steps, *_or_nothing(noise, fixed, fixed_mask), views)

    def guess_loss(self, features: Features, x: Float[Tensor, "b d"], active: Bool[Tensor, "b p"]) -> Float[Tensor, ""]:
        """The loss of the direct regression from the picture's summary."""
        return flow.prediction_loss(self.outputs, self.first_guess(features), x, flow.with_view(active))

    def denoising_loss(
        self, features: Features, x: Float[Tensor, "b d"], active: Bool[Tensor, "b p"], config: TrainConfig
    ) -> Float[Tensor, ""]:
        """The loss at `config.draws` noise levels per picture."""
        condition = self.condition(features).repeat(config.draws)
        x = x.repeat_interleave(config.draws, 0)
        active = flow.with_view(active).repeat_interleave(config.draws, 0)
        return flow.denoising_loss(self.denoiser, condition, x, active, config.lock, config.pure_noise_fraction)


class PaperEstimator(nn.Module):
    """The paper's model: parameters alone, the picture by cross-attention alone, no first guess and no camera.

    `x` has the camera's entries as everywhere; they are not looked at, and come back as those of a fixed view.
    """

    makes_guess = False
    view: Tensor

    def __init__(self, space: ParameterSpace, config: ModelConfig) -> None:
        super().__init__()
        self.config = config
        self.encoder = build_encoder(config)
        self.outputs = Outputs(space)
        self.denoiser = DiT(len(space), self.encoder.channels, config)  # type: ignore[arg-type]
        numbers = torch.from_numpy(encode_view(UNSEEN_VIEW)).float()
        self.register_buffer("view", numbers, persistent=False)

    @property
    def guess(self) -> nn.Module:
        """Raises ValueError: the paper has no direct regression."""
        raise ValueError(NO_GUESS)

    def guess_loss(self, features: Features, x: Float[Tensor, "b d"], active: Bool[Tensor, "b p"]) -> Float[Tensor, ""]:
        """Raises ValueError: the paper has no direct regression."""
        raise ValueError(NO_GUESS)

    def first_guess(self, features: Features) -> Prediction:
        """Raises ValueError: the paper has no direct regression."""
        raise ValueError(NO_GUESS)

    def condition(self, features: Features) -> Condition:
        """What the denoiser attends to, computed once and not per step."""
        nothing = features.tokens.new_zeros(len(features.tokens), 0)
        return Condition(self.denoiser.keys_values(features.tokens), nothing, nothing)

    def sample(
        self,
        condition: Condition,
        noise: Float[Tensor, "b d"],
        steps: int,
        fixed: Float[Tensor, "b d"] | None = None,
        fixed_mask: Bool[Tensor, "b d"] | None = None,
        views: int = 1,
    ) -> Prediction:
        """One draw for each row of noise; fixed entries are led to their values, as noisy as the rest on the way.

        Several views are drawn each for itself.
        """
        every, numbers = ddpm.schedule().to(noise), len(self.denoiser.position)
        fixed, fixed_mask = (part[:, :numbers] for part in _or_nothing(noise, fixed, fixed_mask))

        def predict(x: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
            predicted, variance = self.denoiser(x, t, condition.keys_values)
            return torch.where(fixed_mask, ddpm.noise_from_clean(x, fixed, every.at(t)), predicted), variance

        return self.prediction(ddpm.sample(predict, noise[:, :numbers], steps, _follows_from(noise)))

    def prediction(self, x: Float[Tensor, "b n"]) -> Prediction:
        """Clean parameters as a prediction that is certain of the option whose piece each choice lies in."""
        x = torch.cat([x.clamp(-1, 1), self.view.expand(len(x), -1)], 1)
        return Prediction(x, -1e4 * (x[:, self.outputs.owner] - self.outputs.centres).square())

    def denoising_loss(
        self, features: Features, x: Float[Tensor, "b d"], active: Bool[Tensor, "b p"], config: TrainConfig
    ) -> Float[Tensor, ""]:
        """The paper's loss at one random step per picture, of all parameters whether active or not."""
        x = x[:, :-VIEW_NUMBERS]
        pairs = self.denoiser.keys_values(features.tokens)
        index = torch.randint(ddpm.STEPS, (len(x),), device=x.device)
        return ddpm.loss(lambda noisy, t: self.denoiser(noisy, t, pairs), x, torch.randn_like(x), index)


AnyEstimator = Estimator | PaperEstimator


def build_estimator(space: ParameterSpace, config: ModelConfig) -> AnyEstimator:
    """A network of the configured objective for one parameter space, untrained."""
    return (PaperEstimator if config.objective == "ddpm" else Estimator)(space, config)


def _or_nothing(
    noise: Float[Tensor, "b d"], fixed: Float[Tensor, "b d"] | None, fixed_mask: Bool[Tensor, "b d"] | None
) -> tuple[Float[Tensor, "b d"], Bool[Tensor, "b d"]]:
    """Fixed values and their mask, with nothing fixed where there are none."""
    fixed_mask = torch.zeros_like(noise, dtype=torch.bool) if fixed_mask is None else fixed_mask
    return torch.zeros_like(noise) if fixed is None else fixed, fixed_mask


def _follows_from(noise: Tensor) -> torch.Generator:
    """Randomness for the later steps that the noise of the first decides, so that one seed gives one answer."""
    seed = int(noise.double().sum().cpu().view(torch.int64)) & (2**63 - 1)
    return torch.Generator(noise.device).manual_seed(seed)
