"""The paper's diffusion: noise predicted at 1000 linear steps, a learned variance, fewer steps when sampling.

Sources: Ho et al. 2020 (DDPM), Nichol & Dhariwal 2021 (learned variance, fewer steps); the paper, section 3.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

STEPS = 1000
BETAS = (1e-4, 0.02)  # of the first and the last step

Predict = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
"""From `x` (`b n`) and a time of the 1000 (`b`) to the noise in it and where the variance lies, about [-1, 1]."""


@dataclass(frozen=True)
class Schedule:
    """Some of the 1000 steps, noisiest last: which, how much signal is left, and the variances to choose between."""

    times: Int[Tensor, "..."]
    kept: Float[Tensor, "..."]
    """ᾱ: the share of the variance that is signal"""
    before: Float[Tensor, "..."]
    """ᾱ one step nearer to clean; 1 at the first"""
    betas: Float[Tensor, "..."]
    """variance added by the step: the most that taking it back can need"""
    log_least: Float[Tensor, "..."]
    """log β̃: the variance of taking it back when the clean end is known; the first takes the second's, being 0"""

    def at(self, index: Int[Tensor, " b"]) -> Schedule:
        """The rows of some steps as columns, ready for `x` of shape `b n`."""
        return Schedule(self.times[index], *(part[index, None] for part in self._numbers))

    def to(self, like: Tensor) -> Schedule:
        """The same on the device and in the precision of a tensor."""
        return Schedule(self.times.to(like.device), *(part.to(like) for part in self._numbers))

    @property
    def _numbers(self) -> tuple[Tensor, ...]:
        return self.kept, self.before, self.betas, self.log_least


def schedule(steps: int = STEPS) -> Schedule:
    """`steps` of the 1000 at even distances, with the betas that lead through the same ᾱ; raises ValueError."""
    if not 2 <= steps <= STEPS:
        raise ValueError(f"The paper's recipe is sampled in 2 to {STEPS} steps, got {steps}.")
    times = torch.linspace(0, STEPS - 1, steps, dtype=torch.float64).round().long()
    kept = torch.cumprod(1 - torch.linspace(*BETAS, STEPS, dtype=torch.float64), 0)[times]
    before = torch.cat([kept.new_ones(1), kept[:-1]])
    betas = 1 - kept / before
    least = betas * (1 - before) / (1 - kept)
    return Schedule(times, kept, before, betas, torch.cat([least[1:2], least[1:]]).log())


def add_noise(x: Float[Tensor, "b n"], noise: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """`x` at a step of the way to noise (Ho et al., equation 4)."""
    return step.kept.sqrt() * x + (1 - step.kept).sqrt() * noise


def clean_end(x: Float[Tensor, "b n"], noise: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """What `x` was before this noise: `add_noise` solved for its first argument."""
    return (x - (1 - step.kept).sqrt() * noise) / step.kept.sqrt()


def noise_in(x: Float[Tensor, "b n"], clean: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """What was added to get `x` from a known clean end: `add_noise` solved for its second argument."""
    return (x - step.kept.sqrt() * clean) / (1 - step.kept).sqrt()


def step_back(clean: Float[Tensor, "b n"], x: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """The mean of `x` one step nearer to a known clean end (Ho et al., equation 7)."""
    towards = step.before.sqrt() * step.betas / (1 - step.kept)
    return towards * clean + (1 - step.betas).sqrt() * (1 - step.before) / (1 - step.kept) * x


def log_variance(where: Float[Tensor, "b n"], step: Schedule) -> Float[Tensor, "b n"]:
    """Between the least (-1) and the most (1) that taking the step back can need (Nichol & Dhariwal, equation 15)."""
    share = (where + 1) / 2
    return share * step.betas.log() + (1 - share) * step.log_least


def loss(predict: Predict, x: Float[Tensor, "b n"], noise: Float[Tensor, "b n"], index: Int[Tensor, " b"]) -> Tensor:
    """Squared error of the noise, plus the bound on the likelihood that the variance alone is trained by.

    The sum of equations 14 of Ho et al. and 4 to 6 of Nichol & Dhariwal at one random step, in bits per number.
    """
    step = schedule().to(x).at(index)
    noisy = add_noise(x, noise, step)
    found, where = (part.float() for part in predict(noisy, step.times))
    truth = step_back(x, noisy, step)
    ours = step_back(clean_end(noisy, found.detach(), step), noisy, step)
    bound = gaussian_divergence(truth, step.log_least, ours, log_variance(where, step)) / math.log(2)
    return (found - noise).square().mean() + bound.mean()


def gaussian_divergence(mean: Tensor, log_var: Tensor, other: Tensor, other_log_var: Tensor) -> Tensor:
    """The Kullback-Leibler divergence from the second normal distribution to the first, entry by entry, in nats."""
    ratio = (log_var - other_log_var).exp()
    return (ratio - 1 + other_log_var - log_var + (mean - other).square() * (-other_log_var).exp()) / 2


def sample(
    predict: Predict, x: Float[Tensor, "b n"], steps: int, rng: torch.Generator | None = None
) -> Float[Tensor, "b n"]:
    """Ancestral sampling from noise `x` (Ho et al., algorithm 2), the clean end held to [-1, 1] at every step."""
    plan = schedule(steps).to(x)
    for i in reversed(range(steps)):
        step = plan.at(torch.full((len(x),), i, device=x.device))
        noise, where = predict(x, step.times)
        mean = step_back(clean_end(x, noise, step).clamp(-1, 1), x, step)
        fresh = torch.randn(x.shape, generator=rng, device=x.device, dtype=x.dtype) if i else 0.0
        x = mean + (log_variance(where, step) / 2).exp() * fresh
    return x
