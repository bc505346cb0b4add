"""The paper's diffusion: 1000 steps with linear betas, predicted noise, a learned variance, sampling in fewer steps.

Sources: Ho et al. 2020 (DDPM), Nichol & Dhariwal 2021 (learned variance, fewer steps); the paper, section 3.1. In this
file `x` holds the parameters alone, without a camera, and a step is one of 1000 from clean (0) to noise (999).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

# The paper states neither the number of steps nor the betas of the first and the last one; these are Ho et al.'s.
STEPS = 1000
BETAS = (1e-4, 0.02)

# From `x` (`b n`) and the index of a step (`b`) to the predicted noise and to the fraction v of the log variance, about
# [-1, 1]; see `log_variance`.
Predict = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


@dataclass(frozen=True)
class Schedule:
    """Some of the 1000 steps, from clean to noise, with the numbers that diffusion needs at each of them."""

    times: Int[Tensor, "..."]
    """the index of the step among the 1000"""
    alpha_bar: Float[Tensor, "..."]
    """ᾱ, the share of the variance that is signal after the step"""
    previous_alpha_bar: Float[Tensor, "..."]
    """ᾱ of the previous, less noisy step of this schedule; 1 at the first"""
    betas: Float[Tensor, "..."]
    """β, the variance that the step adds, which is the upper bound of the variance of its reverse"""
    log_posterior_variance: Float[Tensor, "..."]
    """log β̃, the variance of the reverse step for a known clean `x`; the first step has the second one's, as its own
    is 0"""

    def at(self, index: Int[Tensor, " b"]) -> Schedule:
        """The rows of some steps as columns, ready for `x` of shape `b n`."""
        return Schedule(self.times[index], *(part[index, None] for part in self._numbers))

    def to(self, like: Tensor) -> Schedule:
        """The same schedule on the device and in the precision of a tensor."""
        return Schedule(self.times.to(like.device), *(part.to(like) for part in self._numbers))

    @property
    def _numbers(self) -> tuple[Tensor, ...]:
        return self.alpha_bar, self.previous_alpha_bar, self.betas, self.log_posterior_variance


def schedule(steps: int = STEPS) -> Schedule:
    """A schedule of `steps` evenly spaced steps of the 1000, with the betas that give the same ᾱ at these steps.

    Source: Nichol & Dhariwal, section 4. Raises ValueError for fewer than 2 or more than 1000 steps.
    """
    if not 2 <= steps <= STEPS:
        raise ValueError(f"The paper's recipe is sampled in 2 to {STEPS} steps, got {steps}.")
    times = torch.linspace(0, STEPS - 1, steps, dtype=torch.float64).round().long()
    alpha_bar = torch.cumprod(1 - torch.linspace(*BETAS, STEPS, dtype=torch.float64), 0)[times]
    previous = torch.cat([alpha_bar.new_ones(1), alpha_bar[:-1]])
    betas = 1 - alpha_bar / previous
    variance = betas * (1 - previous) / (1 - alpha_bar)
    return Schedule(times, alpha_bar, previous, betas, torch.cat([variance[1:2], variance[1:]]).log())


def add_noise(x: Float[Tensor, "b n"], noise: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """The noisy `x` of a step (Ho et al., equation 4)."""
    return step.alpha_bar.sqrt() * x + (1 - step.alpha_bar).sqrt() * noise


def clean_from_noise(x: Float[Tensor, "b n"], noise: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """The clean `x` under the given noise: `add_noise` solved for its first argument."""
    return (x - (1 - step.alpha_bar).sqrt() * noise) / step.alpha_bar.sqrt()


def noise_from_clean(x: Float[Tensor, "b n"], clean: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """The noise in `x` under the given clean `x`: `add_noise` solved for its second argument."""
    return (x - step.alpha_bar.sqrt() * clean) / (1 - step.alpha_bar).sqrt()


def posterior_mean(clean: Float[Tensor, "b n"], x: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """The mean of the previous, less noisy `x` for a known clean `x` (Ho et al., equation 7)."""
    towards = step.previous_alpha_bar.sqrt() * step.betas / (1 - step.alpha_bar)
    return towards * clean + (1 - step.betas).sqrt() * (1 - step.previous_alpha_bar) / (1 - step.alpha_bar) * x


def log_variance(fraction: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """The log variance of the reverse step, from its lower bound at -1 to its upper bound at 1.

    Source: Nichol & Dhariwal, equation 15, where v = (`fraction` + 1) / 2.
    """
    v = (fraction + 1) / 2
    return v * step.betas.log() + (1 - v) * step.log_posterior_variance


def loss(predict: Predict, x: Float[Tensor, "b n"], noise: Float[Tensor, "b n"], index: Int[Tensor, " b"]) -> Tensor:
    """The loss at one step for each row: squared error of the noise plus the variational bound, in bits for each entry.

    The bound trains the variance alone, because the predicted noise is detached in it. Sources: Ho et al., equation 14;
    Nichol & Dhariwal, equations 4 to 6.
    """
    step = schedule().to(x).at(index)
    noisy = add_noise(x, noise, step)
    predicted, fraction = (part.float() for part in predict(noisy, step.times))
    true_mean = posterior_mean(x, noisy, step)
    mean = posterior_mean(clean_from_noise(noisy, predicted.detach(), step), noisy, step)
    divergence = gaussian_divergence(true_mean, step.log_posterior_variance, mean, log_variance(fraction, step))
    return (predicted - noise).square().mean() + (divergence / math.log(2)).mean()


def gaussian_divergence(mean: Tensor, log_var: Tensor, other: Tensor, other_log_var: Tensor) -> Tensor:
    """The Kullback-Leibler divergence of the first normal distribution from the second, for each entry, in nats."""
    ratio = (log_var - other_log_var).exp()
    return (ratio - 1 + other_log_var - log_var + (mean - other).square() * (-other_log_var).exp()) / 2


def sample(
    predict: Predict, x: Float[Tensor, "b n"], steps: int, rng: torch.Generator | None = None
) -> Float[Tensor, "b n"]:
    """Ancestral sampling from the noise `x` (Ho et al., algorithm 2); the clean `x` is clamped to [-1, 1] in each step.

    Raises ValueError for fewer than 2 or more than 1000 steps.
    """
    plan = schedule(steps).to(x)
    for i in reversed(range(steps)):
        step = plan.at(torch.full((len(x),), i, device=x.device))
        noise, fraction = predict(x, step.times)
        mean = posterior_mean(clean_from_noise(x, noise, step).clamp(-1, 1), x, step)
        fresh = torch.randn(x.shape, generator=rng, device=x.device, dtype=x.dtype) if i else 0.0
        x = mean + (log_variance(fraction, step) / 2).exp() * fresh
    return x
