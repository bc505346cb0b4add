"""The network against closed forms: categories, attention, samplers with a known posterior; what is held or masked."""

from itertools import pairwise

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS
from dipcg.config import ModelConfig
from dipcg.encoders import Features, build_encoder
from dipcg.generators import load_generator
from dipcg.model.denoiser import Condition, Outputs, attend
from dipcg.model.estimators import Estimator
from dipcg.model.flow import denoising_loss, interpolate, prediction_loss, with_view
from dipcg.model.sampling import SAMPLERS, sample
from dipcg.space import Choice, ParameterSpace

TINY = ModelConfig(width=24, depth=2, heads=2, summary=16)
SPACES = {name: load_generator(name).space for name in ("box", "chair")}

every_space = pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)
every_sampler = pytest.mark.parametrize("sampler", SAMPLERS.values(), ids=SAMPLERS)


@pytest.fixture(autouse=True)
def seeded() -> None:
    torch.manual_seed(0)


@pytest.fixture
def model() -> Estimator:
    """Small, in evaluation mode, and with random weights where training starts from zero."""
    model = Estimator(SPACES["box"], TINY)
    for weight in (model.denoiser.read, model.denoiser.read_options):
        torch.nn.init.normal_(weight)
    return model.eval()


@pytest.fixture
def features(model) -> Features:
    with torch.no_grad():
        return model.encoder(torch.rand(2, 3, model.encoder.image_size, model.encoder.image_size))


def dimension(space: ParameterSpace) -> int:
    return len(space) + VIEW_NUMBERS


def pieces(space: ParameterSpace) -> list[tuple[int, Choice, slice]]:
    """Each choice with its place in `x` and the places of its options among the logits."""
    found, start = [], 0
    for i, p in enumerate(space):
        if isinstance(p, Choice):
            found.append((i, p, slice(start, start + len(p.options))))
            start += len(p.options)
    return found


# What the raw numbers mean


@every_space
def test_reals_are_bounded_and_choices_are_expectations_over_their_categories(space):
    outputs = Outputs(space)
    raw = 5 * torch.randn(7, outputs.numbers)
    prediction = outputs(raw)
    expected = torch.tanh(raw[:, : dimension(space)])
    for i, choice, options in pieces(space):
        weights = raw[:, dimension(space) :][:, options].double().softmax(1).numpy()
        expected[:, i] = torch.from_numpy(weights @ choice.centres)
    torch.testing.assert_close(prediction.mean, expected, rtol=0, atol=1e-5)


@every_space
def test_log_probabilities_are_a_softmax_over_each_choice(space):
    outputs = Outputs(space)
    logits = 8 * torch.randn(7, len(outputs.owner))
    found = outputs.log_probabilities(logits)
    for _, _, options in pieces(space):
        torch.testing.assert_close(found[:, options], logits[:, options].log_softmax(1), rtol=0, atol=1e-4)


@every_space
def test_modes_are_the_encoded_options(space):
    outputs, rng = Outputs(space), np.random.default_rng(0)
    for _ in range(10):
        x = padded(space.encode(space.sample(rng)))
        certain = 9.0 * outputs.choice_targets(x) + torch.rand(len(outputs.owner))
        prediction = outputs(torch.cat([torch.atanh(x.clamp(-0.999, 0.999)), certain], 1))
        torch.testing.assert_close(outputs.modes(prediction), x, rtol=0, atol=2e-3)


@every_space
def test_targets_are_one_for_the_encoded_option_of_each_choice(space):
    outputs, rng = Outputs(space), np.random.default_rng(0)
    for i, choice, options in pieces(space):
        for number, option in enumerate(choice.options):
            x = space.encode(space.sample(rng))
            x[i] = space[choice.name].encode(option)
            targets = outputs.choice_targets(padded(x))[0]
            assert targets[options].tolist() == [float(k == number) for k in range(len(choice.options))]
            assert all(targets[others].sum() == 1 for _, _, others in pieces(space))


@every_space
def test_targets_name_the_option_that_decoding_gives(space):
    outputs, rng = Outputs(space), np.random.default_rng(0)
    for x in rng.uniform(-1, 1, (50, len(space))):
        targets = outputs.choice_targets(padded(x))[0]
        for i, choice, options in pieces(space):
            assert targets[options].argmax() == choice.index(choice.decode(x[i]))


def padded(x: np.ndarray) -> Tensor:
    """One row of `x` with a camera in the middle of everything."""
    return F.pad(torch.from_numpy(x).float()[None], (0, VIEW_NUMBERS))


def test_attention_is_that_of_torch_with_its_gradients():
    """With gradients on a CPU it is spelled out."""
    queries, keys, values = (torch.randn(2, 3, n, 8, requires_grad=True) for n in (5, 7, 7))
    ours, theirs = attend(queries, keys, values), F.scaled_dot_product_attention(queries, keys, values)
    torch.testing.assert_close(ours, theirs)
    for a, b in zip(
        *(torch.autograd.grad(y.square().sum(), (queries, keys, values)) for y in (ours, theirs)), strict=True
    ):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-5)
    with torch.no_grad():
        torch.testing.assert_close(attend(queries, keys, values), theirs)


# Samplers


@every_sampler
@pytest.mark.parametrize("steps", [1, 2, 10])
def test_a_perfect_predictor_is_followed_to_the_end(sampler, steps):
    end, start = torch.randn(4, 6), torch.randn(4, 6)
    found = sampler(lambda x, t: end, start, torch.linspace(0, 1, steps + 1))
    torch.testing.assert_close(found, end, rtol=0, atol=1e-6)


MEAN, SPREAD = 0.4, 0.3


def posterior_mean(x: Tensor, t: Tensor) -> Tensor:
    """The clean end expected at `x` when the data are N(MEAN, SPREAD²) and the noise N(0, 1)."""
    return MEAN + t * SPREAD**2 / ((1 - t) ** 2 + t**2 * SPREAD**2) * (x - t * MEAN)


def sampled(sampler, noise: Tensor, steps: int) -> Tensor:
    return sampler(posterior_mean, noise, torch.linspace(0, 1, steps + 1, dtype=torch.float64))


@pytest.mark.parametrize(("name", "order"), [("euler", 1), ("heun", 2)])
def test_samplers_converge_to_the_posterior_with_their_order(name, order):
    """The flow from N(0, 1) to N(MEAN, SPREAD²) takes noise z to MEAN + SPREAD·z."""
    noise = torch.linspace(-3, 3, 13, dtype=torch.float64)[:, None]
    errors = [(sampled(SAMPLERS[name], noise, n) - (MEAN + SPREAD * noise)).abs().max() for n in (50, 100, 200)]
    rates = [float((coarse / fine).log2()) for coarse, fine in pairwise(errors)]
    assert rates == pytest.approx([order, order], abs=0.25)


@every_sampler
def test_sampled_mean_and_spread_are_those_of_the_data(sampler):
    noise = torch.randn(20_000, 1, dtype=torch.float64)
    found = sampled(sampler, noise, 100)
    assert found.mean().item() == pytest.approx(MEAN, abs=0.01)
    assert found.std().item() == pytest.approx(SPREAD, abs=0.01)


def test_the_path_starts_at_noise_and_ends_clean():
    x, noise = torch.randn(3, 5), torch.randn(3, 5)
    torch.testing.assert_close(interpolate(x, noise, torch.zeros(3)), noise)
    torch.testing.assert_close(interpolate(x, noise, torch.ones(3)), x)
    torch.testing.assert_close(interpolate(x, noise, torch.full((3,), 0.25)), 0.25 * x + 0.75 * noise)


# Sampling from the network


@torch.no_grad()
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_the_network_sees_given_entries_at_their_values_at_every_step(model, features, sampler):
    seen: list[tuple] = []
    model.denoiser.register_forward_pre_hook(lambda _, args: seen.append(args))
    size = dimension(SPACES["box"])
    known, given = torch.rand(2, size), torch.rand(2, size) < 0.4
    sample(model, model.condition(features), torch.randn(2, size), 4, sampler, known, given)
    assert len(seen) >= 4
    for x, _, marked, _ in seen:
        assert torch.equal(x[given], known[given])
        assert torch.equal(marked, given)


@torch.no_grad()
def test_given_values_change_the_rest(model, features):
    size = dimension(SPACES["box"])
    noise, given = torch.randn(2, size), torch.arange(size).expand(2, size) < 3
    low, high = (
        sample(model, model.condition(features), noise, 4, known=torch.full((2, size), v), given=given).mean
        for v in (-1.0, 1.0)
    )
    assert (low - high).abs()[:, 3:].max() > 1e-3


@torch.no_grad()
def test_candidates_in_one_batch_equal_candidates_one_by_one(model, features):
    noise = torch.randn(6, dimension(SPACES["box"]))
    together = sample(model, model.condition(features).repeat(3), noise, 5)
    for i in range(6):
        alone = model.condition(Features(*(part[i // 3 : i // 3 + 1] for part in features)))
        found = sample(model, alone, noise[i : i + 1], 5)
        torch.testing.assert_close(found.mean[0], together.mean[i], rtol=0, atol=1e-4)
        torch.testing.assert_close(found.logits[0], together.logits[i], rtol=0, atol=1e-3)


@torch.no_grad()
def test_another_picture_gives_another_answer(model, features):
    prediction = sample(model, model.condition(features), torch.randn(1, dimension(SPACES["box"])).expand(2, -1), 4)
    assert (prediction.mean[0] - prediction.mean[1]).abs().max() > 1e-3


# What the loss asks for


def test_the_loss_is_squared_errors_and_surprises_over_what_is_wanted():
    space = SPACES["box"]
    outputs, rng = Outputs(space), np.random.default_rng(0)
    x = padded(space.encode(space.sample(rng)))
    prediction = outputs(torch.randn(1, outputs.numbers))
    wanted = torch.rand(1, dimension(space)) < 0.7
    terms = 3 * (prediction.mean - x).square()[0]
    for i, choice, options in pieces(space):
        number = choice.index(choice.decode(float(x[0, i])))
        terms[i] = -prediction.logits[0, options].log_softmax(0)[number]
    found = prediction_loss(outputs, prediction, x, wanted)
    torch.testing.assert_close(found, terms[wanted[0]].mean(), rtol=1e-5, atol=1e-5)


def test_inactive_parameters_get_no_gradient(model, features):
    space = SPACES["box"]
    x = torch.rand(2, dimension(space)) * 2 - 1
    inactive = [space.names.index(name) for name in ("top", "overhang", "leg_height")]
    active = torch.ones(2, len(space), dtype=torch.bool)
    active[:, inactive] = False
    denoising = denoising_loss(model.denoiser, model.condition(features), x, with_view(active), lock=0.0)
    loss = model.guess_loss(features, x, active) + denoising
    loss.backward()
    rows = model.guess.weight.grad.abs().sum(1)
    silent = torch.tensor([i in inactive for i in range(dimension(space))])
    silent_options = silent[model.outputs.owner]
    reals = ~model.outputs.is_choice  # a choice is read from its options, not from its token's own number
    for gradient, silenced, asked in (
        (rows[: dimension(space)], silent, ~silent & reals),
        (model.denoiser.read.grad.abs().sum(1), silent, ~silent & reals),
        (rows[dimension(space) :], silent_options, ~silent_options),
        (model.denoiser.read_options.grad.abs().sum(1), silent_options, ~silent_options),
    ):
        assert (gradient[silenced] == 0).all()
        assert (gradient[asked] > 0).all()


def test_inactive_values_do_not_reach_the_loss(model, features):
    space = SPACES["box"]
    x = torch.rand(2, dimension(space)) * 2 - 1
    active = torch.rand(2, len(space)) < 0.5
    other = torch.where(with_view(active), x, -x)
    losses = []
    for values in (x, other):
        torch.manual_seed(1)
        losses.append(denoising_loss(model.denoiser, model.condition(features), values, with_view(active), lock=0.5))
    assert torch.equal(*losses)


def test_the_guess_is_not_trained_through_the_denoiser(model, features):
    """It would otherwise learn to be a useful input instead of a guess."""
    x = torch.rand(2, dimension(SPACES["box"]))
    every = torch.ones_like(x, dtype=torch.bool)
    denoising_loss(model.denoiser, model.condition(features), x, every, 0.0).backward()
    assert model.guess.weight.grad is None


@pytest.mark.parametrize("first", [0.0, 0.25, 1.0])
def test_that_share_of_the_draws_is_pure_noise(model, features, monkeypatch, first):
    """Where the answer is read: random times alone come near to it in one draw of a hundred."""
    count, seen, denoise = 512, [], model.denoiser.forward

    def watched(x: Tensor, t: Tensor, given: Tensor, condition: Condition):
        seen.append(t)
        return denoise(x, t, given, condition)

    monkeypatch.setattr(model.denoiser, "forward", watched)
    condition = model.condition(Features(*(part[:1] for part in features))).repeat(count)
    x = torch.rand(count, dimension(SPACES["box"]))
    denoising_loss(model.denoiser, condition, x, torch.ones_like(x, dtype=torch.bool), 0.0, first)
    assert (seen[0] == 0).float().mean() == pytest.approx(first, abs=0.08)
    assert (seen[0] < 0.1).float().mean() == pytest.approx(first, abs=0.1)


@pytest.mark.parametrize("size", [48, 64, 96, 128, 160, 192])
def test_the_default_encoder_takes_pictures_of_any_size(size):
    encoder = build_encoder(ModelConfig(image_size=128, summary=8)).eval()
    found = encoder(torch.rand(1, 3, size, size))
    assert encoder.image_size == 128
    assert (found.tokens.shape, found.summary.shape) == ((1, 64, 192), (1, 8))


@pytest.mark.parametrize("size", [0, 100, -16])
def test_a_size_that_cannot_be_halved_four_times_is_refused(size):
    with pytest.raises(ValueError, match=f"multiple of 16, got {size}"):
        build_encoder(ModelConfig(image_size=size))
