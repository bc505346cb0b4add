"""The paper's recipe: its network, its encoders, its settings, and a training run."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image

from dipcg.camera import VIEW_NUMBERS, ViewGrid, encode_view
from dipcg.cli import main
from dipcg.config import ModelConfig, TrainConfig
from dipcg.data.store import build_dataset
from dipcg.encoders import build_encoder
from dipcg.generators import load_generator
from dipcg.model.dit import DiT
from dipcg.model.estimators import UNSEEN_VIEW, PaperEstimator, build_estimator
from dipcg.pipeline import Inverter
from dipcg.training.pictures import Batch
from dipcg.training.recipes import RECIPES, find_recipe, published_views
from dipcg.training.train import Run

BOX = load_generator("box")
TINY = ModelConfig(width=24, depth=2, heads=2, summary=0, objective="ddpm", steps=250)


@pytest.fixture(autouse=True)
def seeded() -> None:
    torch.manual_seed(0)


@pytest.fixture
def model() -> PaperEstimator:
    model = PaperEstimator(BOX.space, replace(TINY, encoder="conv", summary=8))
    torch.nn.init.normal_(model.denoiser.leave.weight, std=0.1)
    return model.eval()


def condition_of(model: PaperEstimator, pictures: int):
    with torch.no_grad():
        return model.condition(model.encoder(torch.rand(pictures, 3, 128, 128)))


# The network


@pytest.mark.parametrize(("recipe", "millions"), [("paper", 7.6), ("small", 1.6), ("large", 39.0)])
def test_networks_have_the_published_sizes_within_three_percent(recipe, millions):
    with torch.device("meta"):
        network = DiT(48, 768, RECIPES[recipe].model)
    weights = sum(weight.numel() for weight in network.parameters())
    assert weights / 1e6 == pytest.approx(millions, rel=0.03)
    assert len(network.blocks) == RECIPES[recipe].model.depth


@torch.no_grad()
def test_the_noise_of_each_parameter_depends_on_the_others_and_on_the_picture(model):
    condition, size = condition_of(model, 1), len(BOX.space)
    x, t = torch.rand(1, size), torch.tensor([300])
    before = model.denoiser(x, t, condition.keys_values)[0]
    moved = x + torch.eye(size)[:1]
    assert ((model.denoiser(moved, t, condition.keys_values)[0] - before).abs() > 1e-6).all()
    other = condition_of(model, 1)
    assert ((model.denoiser(x, t, other.keys_values)[0] - before).abs() > 1e-6).all()
    same = torch.full((1, size), 0.5)
    noise = model.denoiser(same, t, condition.keys_values)[0][0]
    assert len(noise.unique()) == size, "equal values differ in their positions"


@torch.no_grad()
def test_samples_of_the_paper_model_are_in_range_and_have_fixed_values(model):
    size = len(BOX.space) + VIEW_NUMBERS
    known, given = torch.rand(3, size) * 2 - 1, torch.rand(3, size) < 0.5
    given[:, -VIEW_NUMBERS:] = False
    prediction = model.sample(condition_of(model, 3), torch.randn(3, size), 20, known, given)
    torch.testing.assert_close(prediction.mean[given], known[given], rtol=0, atol=1e-3)
    assert prediction.mean[:, :-VIEW_NUMBERS].abs().max() <= 1
    np.testing.assert_allclose(prediction.mean[:, -VIEW_NUMBERS:], np.tile(encode_view(UNSEEN_VIEW), (3, 1)), atol=1e-6)


@torch.no_grad()
def test_the_sample_is_a_function_of_the_noise(model):
    condition, size = condition_of(model, 1), len(BOX.space) + VIEW_NUMBERS
    first, second = torch.randn(1, size), torch.randn(1, size)
    draws = [model.sample(condition, noise, 10).mean for noise in (first, first, second)]
    assert torch.equal(draws[0], draws[1])
    assert not torch.equal(draws[0], draws[2])


def test_the_prediction_of_a_choice_is_the_option_whose_interval_contains_x(model):
    x = torch.from_numpy(np.random.default_rng(0).uniform(-1, 1, (40, len(BOX.space)))).float()
    modes = model.outputs.modes(model.prediction(x))[:, :-VIEW_NUMBERS].double().numpy()
    for mode, row in zip(modes, x.double().numpy(), strict=True):
        assert BOX.space.decode(mode) == pytest.approx(BOX.space.decode(row), abs=1e-6)


def test_the_objective_decides_the_network():
    assert isinstance(build_estimator(BOX.space, TINY), PaperEstimator)
    assert not isinstance(build_estimator(BOX.space, replace(TINY, objective="flow", summary=8)), PaperEstimator)


# The encoders


@torch.no_grad()
@pytest.mark.parametrize(("name", "tokens"), [("dinov2", 256), ("clip", 196)])
def test_pretrained_encoders_give_the_patch_tokens_of_their_network(pretrained, name, tokens):
    import transformers

    encoder = build_encoder(ModelConfig(encoder=name, encoder_weights=pretrained[name], summary=0))
    images = torch.rand(2, 3, encoder.image_size, encoder.image_size)
    features = encoder(images)
    network = {"dinov2": transformers.Dinov2Model, "clip": transformers.CLIPVisionModel}[name]
    mean, deviation = {
        "dinov2": ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]),
        "clip": ([0.48145466, 0.4578275, 0.40821073], [0.26862954, 0.26130258, 0.27577711]),
    }[name]
    pixels = (images - torch.tensor(mean).view(3, 1, 1)) / torch.tensor(deviation).view(3, 1, 1)
    expected = network.from_pretrained(pretrained[name]).eval()(pixels).last_hidden_state[:, 1:]
    assert features.tokens.shape == (2, tokens, 32)
    torch.testing.assert_close(features.tokens, expected, rtol=1e-4, atol=1e-5)


def test_a_pretrained_network_is_neither_trained_nor_stored(pretrained):
    encoder = build_encoder(ModelConfig(encoder="dinov2", encoder_weights=pretrained["dinov2"], summary=4))
    assert set(encoder.state_dict()) == {"pool.weight", "pool.bias"}
    assert sum(weight.numel() for weight in encoder.parameters()) == 4 * 32 + 4


def test_the_error_for_missing_weights_has_the_command_that_downloads_them(tmp_path):
    pytest.importorskip("transformers")
    with pytest.raises(RuntimeError, match=r"hf download .*nowhere --local-dir nowhere.*--encoder-weights ./nowhere"):
        build_encoder(ModelConfig(encoder="dinov2", encoder_weights=str(tmp_path / "nowhere")))


# The recipe


def test_the_recipe_has_the_published_settings():
    recipe = find_recipe("paper")
    model, train = recipe.model, recipe.train
    assert (model.encoder, model.width, model.depth, model.heads, model.steps) == ("dinov2", 192, 12, 6, 250)
    assert (train.learning_rate, train.schedule, train.batch, train.ema) == (1e-4, "constant", 128, 0.9999)
    assert train.augment.lines == train.augment.background == train.augment.noise == train.augment.blur == 0
    assert set(vars(RECIPES["single-view"].train.augment).values()) == {0.0}
    assert RECIPES["ours"].model == ModelConfig()
    assert RECIPES["ours"].train == TrainConfig()
    with pytest.raises(ValueError, match=r"There is no recipe 'papier'. There are: ours, paper"):
        find_recipe("papier")


def test_drawn_cameras_are_the_published_ones():
    grid, rng = published_views("chair"), np.random.default_rng(0)
    cameras = {(v.azimuth_deg, v.elevation_deg, v.distance) for v in (grid.sample(rng) for _ in range(500))}
    assert cameras == {(a, e, d) for a in (0, 30, 60, 80) for e in (10, 30, 40) for d in (1.8, 2.0)}
    assert published_views("box") == ViewGrid((0, 30, 60), (30, 60), (1.8, 2.0))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "box"
    build_dataset("box", folder, 20)
    return folder


def test_flags_replace_settings_of_a_recipe(data, tmp_path, monkeypatch):
    runs: list[tuple[TrainConfig, ModelConfig]] = []
    monkeypatch.setattr(
        "dipcg.training.train.train", lambda data, out, train, model, report: runs.append((train, model))
    )
    words = ["train", "box", "--data", str(data), "-o", str(tmp_path)]
    main([*words, "--recipe", "small", "--batch", "8", "--augment.mask", "0.5"])
    main([*words, "--width", "24"])
    main([*words, "--pictures", "1.5m", "--width", "24"])
    small = RECIPES["small"]
    changed = replace(small.train, batch=8, augment=replace(small.train.augment, mask=0.5))
    longer = TrainConfig(pictures=1_500_000)
    narrow = ModelConfig(width=24)
    assert runs == [(changed, small.model), (TrainConfig(), narrow), (longer, narrow)]
    with pytest.raises(SystemExit):
        main([*words, "--recipe", "papier"])


@pytest.fixture(scope="module")
def trained(tmp_path_factory, pretrained):
    """A run of a few steps on random pictures, with its checkpoint."""
    torch.manual_seed(0)
    config = replace(RECIPES["paper"].train, batch=8, learning_rate=1e-3)
    model = build_estimator(BOX.space, replace(TINY, encoder="dinov2", encoder_weights=pretrained["dinov2"]))
    run = Run(model, config, tmp_path_factory.mktemp("run") / "box", BOX)
    active = torch.ones(8, len(BOX.space), dtype=torch.bool)
    images = torch.rand(8, 3, 224, 224)
    batch = Batch(images, torch.rand(8, len(BOX.space) + VIEW_NUMBERS) * 2 - 1, active)
    losses = [run.learn(batch) for _ in range(40)]
    validation = run.check(batch)
    return run, losses, validation


def test_a_run_of_the_recipe_reduces_its_loss_and_is_validated_without_a_guess(trained):
    run, losses, validation = trained
    assert np.mean(losses[-10:]) < 0.8 * np.mean(losses[:5])
    assert run.optimisers["adamw"].param_groups[0]["lr"] == 1e-3
    assert (validation.guess_reals, validation.guess_choices) == (None, None)
    assert 0 < validation.sample_reals < 2
    again = Run(build_estimator(BOX.space, run.model.config), run.config, run.out, BOX)
    assert again.counters["step"] == run.counters["step"] == 40


def test_a_checkpoint_of_the_recipe_estimates_in_250_steps(trained, tmp_path):
    calls: list[int] = []
    Image.fromarray(np.pad(np.full((40, 30, 3), 90, np.uint8), ((20, 20), (20, 20), (0, 0)), constant_values=255)).save(
        tmp_path / "box.png"
    )
    with Inverter.load(str(trained[0].out)) as inverter:
        inverter.model.denoiser.register_forward_pre_hook(lambda _, args: calls.append(len(args[0])))
        estimate = inverter.estimate(tmp_path / "box.png", candidates=3)
        assert calls == [8] * 250 + [2] * 250
        assert BOX.space.validate(estimate.params) == estimate.params
        assert vars(estimate.view) == pytest.approx(vars(UNSEEN_VIEW), abs=1e-4)
        fixed = inverter.estimate(tmp_path / "box.png", candidates=2, steps=10, fixed={"width": 0.5, "top": "flat"})
        assert all(c.params["width"] == 0.5 and c.params["top"] == "flat" for c in fixed.candidates)
        with pytest.raises(ValueError, match="has no direct guess"):
            inverter.guess(tmp_path / "box.png")
