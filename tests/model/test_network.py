"""The network and the samplers compared with closed forms, and the effects of fixed and of inactive parameters."""

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
    """A small network in evaluation mode, with random weights in place of the output weights that start at zero."""
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


def choices_of(space: ParameterSpace) -> list[tuple[int, Choice, slice]]:
    """Each choice with its index in `x` and the slice of its options among the logits."""
    choices, start = [], 0
    for i, p in enumerate(space):
        if isinstance(p, Choice):
            choices.append((i, p, slice(start, start + len(p.options))))
            start += len(p.options)
    return choices


# Raw outputs and predictions


@every_space
def test_reals_are_bounded_and_choices_are_expectations_over_their_options(space):
    outputs = Outputs(space)
    raw = 5 * torch.randn(7, outputs.numbers)
    prediction = outputs(raw)
    expected = torch.tanh(raw[:, : dimension(space)])
    for i, choice, options in choices_of(space):
        weights = raw[:, dimension(space) :][:, options].double().softmax(1).numpy()
        expected[:, i] = torch.from_numpy(weights @ choice.centres)
    torch.testing.assert_close(prediction.mean, expected, rtol=0, atol=1e-5)


@every_space
def test_log_probabilities_are_a_softmax_over_each_choice(space):
    outputs = Outputs(space)
    logits = 8 * torch.randn(7, len(outputs.owner))
    log_probabilities = outputs.log_probabilities(logits)
    for _, _, options in choices_of(space):
        torch.testing.assert_close(log_probabilities[:, options], logits[:, options].log_softmax(1), rtol=0, atol=1e-4)


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
    for i, choice, options in choices_of(space):
        for number, option in enumerate(choice.options):
            x = space.encode(space.sample(rng))
            x[i] = space[choice.name].encode(option)
            targets = outputs.choice_targets(padded(x))[0]
            assert targets[options].tolist() == [float(k == number) for k in range(len(choice.options))]
            assert all(targets[others].sum() == 1 for _, _, others in choices_of(space))


@every_space
def test_targets_are_one_for_the_decoded_option(space):
    outputs, rng = Outputs(space), np.random.default_rng(0)
    for x in rng.uniform(-1, 1, (50, len(space))):
        targets = outputs.choice_targets(padded(x))[0]
        for i, choice, options in choices_of(space):
            assert targets[options].argmax() == choice.index(choice.decode(x[i]))


def padded(x: np.ndarray) -> Tensor:
    """One row of `x` with zeros for the numbers of the camera."""
    return F.pad(torch.from_numpy(x).float()[None], (0, VIEW_NUMBERS))


def test_attention_and_its_gradients_equal_those_of_torch():
    """With gradients on a CPU, attention is written out as matrix products."""
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
def test_samplers_end_at_a_constant_prediction(sampler, steps):
    end, start = torch.randn(4, 6), torch.randn(4, 6)
    sampled = sampler(lambda x, t: end, start, torch.linspace(0, 1, steps + 1))
    torch.testing.assert_close(sampled, end, rtol=0, atol=1e-6)


# The mean and the standard deviation of one-dimensional data.
MEAN, DEVIATION = 0.4, 0.3


def posterior_mean(x: Tensor, t: Tensor) -> Tensor:
    """The expectation of the clean `x` when the data are N(MEAN, DEVIATION²) and the noise is N(0, 1)."""
    return MEAN + t * DEVIATION**2 / ((1 - t) ** 2 + t**2 * DEVIATION**2) * (x - t * MEAN)


def sampled_data(sampler, noise: Tensor, steps: int) -> Tensor:
    return sampler(posterior_mean, noise, torch.linspace(0, 1, steps + 1, dtype=torch.float64))


@pytest.mark.parametrize(("name", "order"), [("euler", 1), ("heun", 2)])
def test_samplers_converge_with_their_order(name, order):
    """The flow from N(0, 1) to N(MEAN, DEVIATION²) maps noise z to MEAN + DEVIATION·z."""
    noise = torch.linspace(-3, 3, 13, dtype=torch.float64)[:, None]
    errors = [(sampled_data(SAMPLERS[name], noise, n) - (MEAN + DEVIATION * noise)).abs().max() for n in (50, 100, 200)]
    rates = [float((coarse / fine).log2()) for coarse, fine in pairwise(errors)]
    assert rates == pytest.approx([order, order], abs=0.25)


@every_sampler
def test_samples_have_the_mean_and_the_deviation_of_the_data(sampler):
    noise = torch.randn(20_000, 1, dtype=torch.float64)
    samples = sampled_data(sampler, noise, 100)
    assert samples.mean().item() == pytest.approx(MEAN, abs=0.01)
    assert samples.std().item() == pytest.approx(DEVIATION, abs=0.01)


def test_the_path_leads_from_noise_to_clean_x():
    x, noise = torch.randn(3, 5), torch.randn(3, 5)
    torch.testing.assert_close(interpolate(x, noise, torch.zeros(3)), noise)
    torch.testing.assert_close(interpolate(x, noise, torch.ones(3)), x)
    torch.testing.assert_close(interpolate(x, noise, torch.full((3,), 0.25)), 0.25 * x + 0.75 * noise)


# Sampling from the network


@torch.no_grad()
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_the_network_gets_fixed_entries_at_their_values_in_every_step(model, features, sampler):
    calls: list[tuple] = []
    model.denoiser.register_forward_pre_hook(lambda _, args: calls.append(args))
    size = dimension(SPACES["box"])
    known, given = torch.rand(2, size), torch.rand(2, size) < 0.4
    sample(model.denoiser, model.condition(features), torch.randn(2, size), 4, known, given, sampler=sampler)
    assert len(calls) >= 4
    for x, _, fixed_mask, _ in calls:
        assert torch.equal(x[given], known[given])
        assert torch.equal(fixed_mask, given)


@torch.no_grad()
def test_fixed_values_change_the_other_entries(model, features):
    size = dimension(SPACES["box"])
    noise, given = torch.randn(2, size), torch.arange(size).expand(2, size) < 3
    low, high = (
        model.sample(model.condition(features), noise, 4, torch.full((2, size), v), given).mean for v in (-1.0, 1.0)
    )
    assert (low - high).abs()[:, 3:].max() > 1e-3


@torch.no_grad()
def test_candidates_in_one_batch_equal_candidates_one_by_one(model, features):
    noise = torch.randn(6, dimension(SPACES["box"]))
    together = model.sample(model.condition(features).repeat(3), noise, 5)
    for i in range(6):
        alone = model.condition(Features(*(part[i // 3 : i // 3 + 1] for part in features)))
        single = model.sample(alone, noise[i : i + 1], 5)
        torch.testing.assert_close(single.mean[0], together.mean[i], rtol=0, atol=1e-4)
        torch.testing.assert_close(single.logits[0], together.logits[i], rtol=0, atol=1e-3)


@torch.no_grad()
def test_another_picture_gives_another_prediction(model, features):
    prediction = model.sample(model.condition(features), torch.randn(1, dimension(SPACES["box"])).expand(2, -1), 4)
    assert (prediction.mean[0] - prediction.mean[1]).abs().max() > 1e-3


# The loss


def test_the_loss_is_the_mean_of_squared_errors_and_cross_entropies_over_the_counted_entries():
    space = SPACES["box"]
    outputs, rng = Outputs(space), np.random.default_rng(0)
    x = padded(space.encode(space.sample(rng)))
    prediction = outputs(torch.randn(1, outputs.numbers))
    counted = torch.rand(1, dimension(space)) < 0.7
    terms = 3 * (prediction.mean - x).square()[0]
    for i, choice, options in choices_of(space):
        number = choice.index(choice.decode(float(x[0, i])))
        terms[i] = -prediction.logits[0, options].log_softmax(0)[number]
    loss = prediction_loss(outputs, prediction, x, counted)
    torch.testing.assert_close(loss, terms[counted[0]].mean(), rtol=1e-5, atol=1e-5)


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
    masked = torch.tensor([i in inactive for i in range(dimension(space))])
    masked_options = masked[model.outputs.owner]
    # The prediction of a choice comes from its logits, so the raw output of its own entry has no gradient.
    reals = ~model.outputs.is_choice
    for gradient, zero, positive in (
        (rows[: dimension(space)], masked, ~masked & reals),
        (model.denoiser.read.grad.abs().sum(1), masked, ~masked & reals),
        (rows[dimension(space) :], masked_options, ~masked_options),
        (model.denoiser.read_options.grad.abs().sum(1), masked_options, ~masked_options),
    ):
        assert (gradient[zero] == 0).all()
        assert (gradient[positive] > 0).all()


def test_the_loss_does_not_depend_on_inactive_values(model, features):
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
    """With this gradient the guess would become an input of the denoiser that is no estimate by itself."""
    x = torch.rand(2, dimension(SPACES["box"]))
    every = torch.ones_like(x, dtype=torch.bool)
    denoising_loss(model.denoiser, model.condition(features), x, every, 0.0).backward()
    assert model.guess.weight.grad is None


@pytest.mark.parametrize("fraction", [0.0, 0.25, 1.0])
def test_the_fraction_of_draws_from_pure_noise_is_as_configured(model, features, monkeypatch, fraction):
    """The expectation is read at time 0, and one random time in a hundred is below 0.1."""
    count, times, denoise = 512, [], model.denoiser.forward

    def recorded(x: Tensor, t: Tensor, fixed_mask: Tensor, condition: Condition):
        times.append(t)
        return denoise(x, t, fixed_mask, condition)

    monkeypatch.setattr(model.denoiser, "forward", recorded)
    condition = model.condition(Features(*(part[:1] for part in features))).repeat(count)
    x = torch.rand(count, dimension(SPACES["box"]))
    denoising_loss(model.denoiser, condition, x, torch.ones_like(x, dtype=torch.bool), 0.0, fraction)
    assert (times[0] == 0).float().mean() == pytest.approx(fraction, abs=0.08)
    assert (times[0] < 0.1).float().mean() == pytest.approx(fraction, abs=0.1)


@pytest.mark.parametrize("size", [48, 64, 96, 128, 160, 192])
def test_the_default_encoder_takes_pictures_of_any_size(size):
    encoder = build_encoder(ModelConfig(image_size=128, summary=8)).eval()
    features = encoder(torch.rand(1, 3, size, size))
    assert encoder.image_size == 128
    assert (features.tokens.shape, features.summary.shape) == ((1, 64, 192), (1, 8))


@pytest.mark.parametrize("size", [0, 100, -16])
def test_a_size_that_cannot_be_halved_four_times_is_refused(size):
    with pytest.raises(ValueError, match=f"multiple of 16, got {size}"):
        build_encoder(ModelConfig(image_size=size))
