"""The paper's diffusion: compared with closed forms, with diffusers, and with the data that samples must follow."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.distributions import Normal, kl_divergence

from dipcg.model import ddpm

PLAN = ddpm.schedule(40)
# The mean and the standard deviation of the one-dimensional data below; nearly all of it lies in [-1, 1].
MEAN, DEVIATION = 0.3, 0.15


@pytest.fixture(autouse=True)
def seeded() -> None:
    torch.manual_seed(0)


def test_a_thousand_steps_have_the_published_betas_and_alpha_bars():
    plan = ddpm.schedule()
    betas = np.linspace(1e-4, 0.02, 1000)
    np.testing.assert_allclose(plan.betas, betas, rtol=1e-9)
    np.testing.assert_allclose(plan.alpha_bar, np.cumprod(1 - betas), rtol=1e-9)


@pytest.mark.parametrize("steps", [2, 10, 250])
def test_fewer_steps_have_the_same_alpha_bars(steps):
    plan, every = ddpm.schedule(steps), ddpm.schedule()
    assert (plan.times[0], plan.times[-1], len(plan.times.unique())) == (0, 999, steps)
    assert torch.equal(plan.alpha_bar, every.alpha_bar[plan.times])
    torch.testing.assert_close((1 - plan.betas).cumprod(0), plan.alpha_bar)


def test_too_few_and_too_many_steps_are_refused():
    for steps in (1, 1001):
        with pytest.raises(ValueError, match=f"in 2 to 1000 steps, got {steps}"):
            ddpm.schedule(steps)


def test_the_posterior_is_the_product_of_two_normal_distributions():
    """The closed form of q(x_{t-1} | x_t, x_0) equals Bayes' rule on a grid."""
    plan = ddpm.schedule(50)
    for i in (1, 7, 49):
        step, clean, x = plan.at(torch.tensor([i])), 0.4, -0.7
        grid = torch.linspace(-6, 6, 200_001, dtype=torch.float64)
        previous = step.previous_alpha_bar.item()
        prior = Normal(math.sqrt(previous) * clean, math.sqrt(1 - previous)).log_prob(grid)
        likelihood = Normal((1 - step.betas).sqrt() * grid, step.betas.sqrt()).log_prob(torch.tensor(x))[0]
        weights = (prior + likelihood).softmax(0)
        mean = (weights * grid).sum()
        variance = (weights * (grid - mean) ** 2).sum()
        closed_form = ddpm.posterior_mean(torch.tensor([[clean]]).double(), torch.tensor([[x]]).double(), step)
        assert closed_form.item() == pytest.approx(mean.item(), abs=1e-6)
        assert step.log_posterior_variance.exp().item() == pytest.approx(variance.item(), rel=1e-4)


def test_noise_and_clean_x_are_recovered_from_noisy_x():
    x, noise = torch.rand(4, 3) * 2 - 1, torch.randn(4, 3)
    step = ddpm.schedule().to(x).at(torch.tensor([0, 10, 500, 900]))
    noisy = ddpm.add_noise(x, noise, step)
    torch.testing.assert_close(ddpm.clean_from_noise(noisy, noise, step), x, rtol=0, atol=1e-3)
    torch.testing.assert_close(ddpm.noise_from_clean(noisy, x, step), noise, rtol=0, atol=1e-3)


def exact_prediction(x: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
    """The expected noise in `x` when the data are N(MEAN, DEVIATION²), and the fraction of the exact log variance."""
    step = PLAN.at((PLAN.times == t[0]).nonzero()[0].expand(len(x)))
    noise_variance = 1 - step.alpha_bar
    # The variance of the clean x for this x.
    clean_variance = DEVIATION**2 * noise_variance / (step.alpha_bar * DEVIATION**2 + noise_variance)
    clean = MEAN + step.alpha_bar.sqrt() * clean_variance / noise_variance * (x - step.alpha_bar.sqrt() * MEAN)
    slope = ddpm.posterior_mean(torch.ones_like(x), torch.zeros_like(x), step)
    posterior_variance = step.betas * (1 - step.previous_alpha_bar) / noise_variance
    low, high = step.log_posterior_variance, step.betas.log()
    v = ((posterior_variance + slope**2 * clean_variance).log() - low) / (high - low)
    return ddpm.noise_from_clean(x, clean, step), 2 * v - 1


def test_samples_of_an_exact_prediction_follow_the_data():
    noise = torch.randn(5_000, 1, dtype=torch.float64)
    samples = ddpm.sample(exact_prediction, noise, 40, torch.Generator().manual_seed(1))
    assert samples.mean().item() == pytest.approx(MEAN, abs=0.007)
    assert samples.std().item() == pytest.approx(DEVIATION, rel=0.06)


def test_the_loss_is_the_squared_error_of_the_noise_plus_the_divergence_of_the_step():
    x, noise, index = torch.rand(5, 3).double(), torch.randn(5, 3).double(), torch.tensor([1, 5, 99, 500, 999])
    predicted, fraction = torch.randn(5, 3).double(), torch.rand(5, 3).double() * 2 - 1
    step = ddpm.schedule().at(index)
    noisy = ddpm.add_noise(x, noise, step)
    clean = (noisy - (1 - step.alpha_bar).sqrt() * predicted) / step.alpha_bar.sqrt()
    v = (fraction + 1) / 2
    deviation = (v * step.betas.log() + (1 - v) * step.log_posterior_variance).exp().sqrt()
    true_step = Normal(ddpm.posterior_mean(x, noisy, step), step.log_posterior_variance.exp().sqrt())
    bound = kl_divergence(true_step, Normal(ddpm.posterior_mean(clean, noisy, step), deviation))
    expected = (predicted - noise).square().mean() + bound.mean() / math.log(2)
    loss = ddpm.loss(lambda *_: (predicted, fraction), x, noise, index)
    assert loss.item() == pytest.approx(expected.item(), rel=1e-4)


def test_the_bound_trains_the_variance_alone():
    x, noise, index = torch.rand(64, 3), torch.randn(64, 3), torch.randint(1000, (64,))
    predicted, fraction = torch.randn(64, 3, requires_grad=True), torch.zeros(64, 3, requires_grad=True)
    ddpm.loss(lambda *_: (predicted, fraction), x, noise, index).backward()
    expected = 2 * (predicted - noise).detach() / predicted.numel()
    torch.testing.assert_close(predicted.grad, expected, rtol=1e-4, atol=1e-6)
    assert fraction.grad.abs().min() > 0


def test_steps_equal_those_of_diffusers():
    schedulers = pytest.importorskip("diffusers.schedulers.scheduling_ddpm")
    settings = {"beta_schedule": "linear", "beta_start": 1e-4, "beta_end": 0.02, "clip_sample": True}
    theirs = schedulers.DDPMScheduler(1000, variance_type="learned_range", **settings)
    plan, x = ddpm.schedule().to(torch.zeros(1)), torch.randn(2, 4)
    for i in (999, 400, 3):
        noise, fraction = torch.randn(2, 4), torch.rand(2, 4) * 2 - 1
        made = theirs.step(torch.cat([noise, fraction], 1), i, x, generator=torch.Generator().manual_seed(i))
        step = plan.at(torch.full((2,), i))
        mean = ddpm.posterior_mean(ddpm.clean_from_noise(x, noise, step).clamp(-1, 1), x, step)
        fresh = torch.randn(x.shape, generator=torch.Generator().manual_seed(i))
        ours = mean + (ddpm.log_variance(fraction, step) / 2).exp() * fresh
        torch.testing.assert_close(ours, made.prev_sample, rtol=1e-4, atol=1e-4)
