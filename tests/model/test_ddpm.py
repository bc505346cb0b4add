"""The paper's diffusion against closed forms, diffusers, and data that it must give back."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.distributions import Normal, kl_divergence

from dipcg.model import ddpm

PLAN = ddpm.schedule(40)
MEAN, SPREAD = 0.3, 0.15  # of the one-dimensional data below: nearly all of it is in [-1, 1]


@pytest.fixture(autouse=True)
def seeded() -> None:
    torch.manual_seed(0)


def test_a_thousand_steps_have_the_published_betas_and_products():
    plan = ddpm.schedule()
    betas = np.linspace(1e-4, 0.02, 1000)
    np.testing.assert_allclose(plan.betas, betas, rtol=1e-9)
    np.testing.assert_allclose(plan.kept, np.cumprod(1 - betas), rtol=1e-9)


@pytest.mark.parametrize("steps", [2, 10, 250])
def test_fewer_steps_pass_through_the_same_points(steps):
    plan, every = ddpm.schedule(steps), ddpm.schedule()
    assert (plan.times[0], plan.times[-1], len(plan.times.unique())) == (0, 999, steps)
    assert torch.equal(plan.kept, every.kept[plan.times])
    torch.testing.assert_close((1 - plan.betas).cumprod(0), plan.kept)


def test_too_few_and_too_many_steps_are_refused():
    for steps in (1, 1001):
        with pytest.raises(ValueError, match=f"in 2 to 1000 steps, got {steps}"):
            ddpm.schedule(steps)


def test_the_way_back_is_the_product_of_two_normal_distributions():
    """q(x_{t-1} | x_t, x_0) by Bayes, on a grid, against the closed form."""
    plan = ddpm.schedule(50)
    for i in (1, 7, 49):
        step, clean, x = plan.at(torch.tensor([i])), 0.4, -0.7
        grid = torch.linspace(-6, 6, 200_001, dtype=torch.float64)
        prior = Normal(step.before.sqrt().item() * clean, (1 - step.before).sqrt().item()).log_prob(grid)
        seen = Normal((1 - step.betas).sqrt() * grid, step.betas.sqrt()).log_prob(torch.tensor(x))[0]
        weights = (prior + seen).softmax(0)
        mean = (weights * grid).sum()
        found = ddpm.step_back(torch.tensor([[clean]]).double(), torch.tensor([[x]]).double(), step)
        assert found.item() == pytest.approx(mean.item(), abs=1e-6)
        assert step.log_least.exp().item() == pytest.approx((weights * (grid - mean) ** 2).sum().item(), rel=1e-4)


def test_noise_and_clean_end_are_recovered_from_their_mixture():
    x, noise = torch.rand(4, 3) * 2 - 1, torch.randn(4, 3)
    step = ddpm.schedule().to(x).at(torch.tensor([0, 10, 500, 900]))
    noisy = ddpm.add_noise(x, noise, step)
    torch.testing.assert_close(ddpm.clean_end(noisy, noise, step), x, rtol=0, atol=1e-3)
    torch.testing.assert_close(ddpm.noise_in(noisy, x, step), noise, rtol=0, atol=1e-3)


def perfect(x: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
    """The noise expected in `x` when the data are N(MEAN, SPREAD²), and the variance that the step back then has."""
    step = PLAN.at((PLAN.times == t[0]).nonzero()[0].expand(len(x)))
    left = SPREAD**2 * (1 - step.kept) / (step.kept * SPREAD**2 + 1 - step.kept)  # variance of the clean end given x
    clean = MEAN + step.kept.sqrt() * left / (1 - step.kept) * (x - step.kept.sqrt() * MEAN)
    slope = ddpm.step_back(torch.ones_like(x), torch.zeros_like(x), step)
    least = step.betas * (1 - step.before) / (1 - step.kept)
    share = ((least + slope**2 * left).log() - step.log_least) / (step.betas.log() - step.log_least)
    return ddpm.noise_in(x, clean, step), 2 * share - 1


def test_sampling_with_a_perfect_predictor_gives_the_data():
    noise = torch.randn(5_000, 1, dtype=torch.float64)
    found = ddpm.sample(perfect, noise, 40, torch.Generator().manual_seed(1))
    assert found.mean().item() == pytest.approx(MEAN, abs=0.007)
    assert found.std().item() == pytest.approx(SPREAD, rel=0.06)


def test_the_loss_is_the_error_of_the_noise_plus_the_divergence_of_the_step():
    x, noise, index = torch.rand(5, 3).double(), torch.randn(5, 3).double(), torch.tensor([1, 5, 99, 500, 999])
    guess, where = torch.randn(5, 3).double(), torch.rand(5, 3).double() * 2 - 1
    step = ddpm.schedule().at(index)
    noisy = ddpm.add_noise(x, noise, step)
    ours = ddpm.step_back((noisy - (1 - step.kept).sqrt() * guess) / step.kept.sqrt(), noisy, step)
    share = (where + 1) / 2
    deviation = (share * step.betas.log() + (1 - share) * step.log_least).exp().sqrt()
    bound = kl_divergence(Normal(ddpm.step_back(x, noisy, step), step.log_least.exp().sqrt()), Normal(ours, deviation))
    expected = (guess - noise).square().mean() + bound.mean() / math.log(2)
    found = ddpm.loss(lambda *_: (guess, where), x, noise, index)
    assert found.item() == pytest.approx(expected.item(), rel=1e-4)


def test_the_bound_trains_the_variance_alone():
    x, noise, index = torch.rand(64, 3), torch.randn(64, 3), torch.randint(1000, (64,))
    guess, where = torch.randn(64, 3, requires_grad=True), torch.zeros(64, 3, requires_grad=True)
    ddpm.loss(lambda *_: (guess, where), x, noise, index).backward()
    torch.testing.assert_close(guess.grad, 2 * (guess - noise).detach() / guess.numel(), rtol=1e-4, atol=1e-6)
    assert where.grad.abs().min() > 0


def test_steps_are_those_of_diffusers():
    schedulers = pytest.importorskip("diffusers.schedulers.scheduling_ddpm")
    settings = {"beta_schedule": "linear", "beta_start": 1e-4, "beta_end": 0.02, "clip_sample": True}
    theirs = schedulers.DDPMScheduler(1000, variance_type="learned_range", **settings)
    plan, x = ddpm.schedule().to(torch.zeros(1)), torch.randn(2, 4)
    for i in (999, 400, 3):
        noise, where = torch.randn(2, 4), torch.rand(2, 4) * 2 - 1
        made = theirs.step(torch.cat([noise, where], 1), i, x, generator=torch.Generator().manual_seed(i))
        step = plan.at(torch.full((2,), i))
        mean = ddpm.step_back(ddpm.clean_end(x, noise, step).clamp(-1, 1), x, step)
        fresh = torch.randn(x.shape, generator=torch.Generator().manual_seed(i))
        ours = mean + (ddpm.log_variance(where, step) / 2).exp() * fresh
        torch.testing.assert_close(ours, made.prev_sample, rtol=1e-4, atol=1e-4)
