"""A run: killed, interrupted or starved it ends where an undisturbed one does, and it never goes on with nonsense."""

from dataclasses import replace

import pytest
import torch

from dipcg.config import ModelConfig, TrainConfig
from dipcg.data.store import build_dataset
from dipcg.generators import load_generator
from dipcg.model.checkpoint import load_checkpoint
from dipcg.model.estimators import build_estimator
from dipcg.training import train as training
from dipcg.training.train import Run, TrainingError, train

TINY = ModelConfig(image_size=32, width=16, depth=1, heads=2, summary=16)
CONFIG = TrainConfig(pictures=256, batch=16, denoiser_share=0.25, device="cpu")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "box"
    build_dataset("box", folder, 40)
    return folder


@pytest.fixture(autouse=True)
def few_checks(monkeypatch):
    monkeypatch.setattr(training, "VALIDATION_PICTURES", 8)
    monkeypatch.setattr(training, "REPORT_EVERY", 1)


def interrupt_after(pictures: int):
    def report(status) -> None:
        if status.pictures >= pictures:
            raise KeyboardInterrupt

    return report


def test_an_interrupted_run_ends_where_an_undisturbed_one_does(data, tmp_path):
    through = train(data, tmp_path / "through", CONFIG, TINY)
    for pictures in (96, 224):
        with pytest.raises(KeyboardInterrupt):
            train(data, tmp_path / "broken", CONFIG, TINY, interrupt_after(pictures))
        assert (tmp_path / "broken" / "state.safetensors").is_file()
    resumed = train(data, tmp_path / "broken", CONFIG, TINY)
    other = train(data, tmp_path / "other", replace(CONFIG, seed=1), TINY)
    assert apart(through, resumed) < 0.1 * apart(through, other)


def apart(one: torch.nn.Module, other: torch.nn.Module) -> float:
    """The largest difference of the encoders' outputs for one picture."""
    image = torch.rand(1, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        return float((one.encoder(image).summary - other.encoder(image).summary).abs().max())


def test_in_the_last_stage_the_encoder_stays_as_it_is(data, tmp_path):
    train(data, tmp_path / "run", replace(CONFIG, denoiser_share=0.5), TINY)
    card = load_checkpoint(tmp_path / "run")[2]
    assert card["pictures"] == 256
    assert card["validation"]["sample_reals"] is not None
    box = load_generator("box")
    run = Run(
        build_estimator(box.space, TINY), replace(CONFIG, denoiser_share=0.5, pictures=1000), tmp_path / "run", box
    )
    run.counters["pictures"] = 600
    batch = training._validation_batch(data, run)
    before = {name: weight.clone() for name, weight in run.model.state_dict().items()}
    run.learn(batch)
    run.learn(batch)
    changed = {
        name.split(".")[0] for name, weight in run.model.state_dict().items() if not torch.equal(weight, before[name])
    }
    assert changed == {"denoiser"}
    assert torch.equal(run.model.guess.weight, run.averaged.guess.weight)


def test_an_unfinished_checkpoint_takes_pictures_of_the_size_that_it_was_trained_on(data, tmp_path, monkeypatch):
    monkeypatch.setattr(training, "VALIDATE_EVERY_S", 0.0)
    for pictures, size in ((48, 16), (208, 32)):
        with pytest.raises(KeyboardInterrupt):
            train(data, tmp_path / "run", CONFIG, TINY, interrupt_after(pictures))
        assert load_checkpoint(tmp_path / "run")[0].encoder.image_size == size


def test_a_finished_run_says_so(data, tmp_path):
    train(data, tmp_path / "run", CONFIG, TINY)
    with pytest.raises(ValueError, match=r"is finished; give a larger budget \(--pictures\)"):
        train(data, tmp_path / "run", CONFIG, TINY)
    train(data, tmp_path / "run", replace(CONFIG, pictures=288), TINY)
    assert load_checkpoint(tmp_path / "run")[2]["pictures"] == 288


@pytest.mark.parametrize(
    ("config", "model", "words"),
    [
        ({"learning_rate": 0.1}, {}, "learning_rate was 0.001 and is 0.1"),
        ({}, {"depth": 2}, "depth was 1 and is 2"),
    ],
)
def test_a_run_with_other_settings_is_not_continued(data, tmp_path, config, model, words):
    with pytest.raises(KeyboardInterrupt):
        train(data, tmp_path / "run", CONFIG, TINY, interrupt_after(0))
    with pytest.raises(ValueError, match=words):
        train(data, tmp_path / "run", replace(CONFIG, **config), replace(TINY, **model))


def test_a_loss_that_is_no_number_stops_the_run_and_keeps_the_last_good_state(data, tmp_path, monkeypatch):
    with pytest.raises(KeyboardInterrupt):
        train(data, tmp_path / "run", CONFIG, TINY, interrupt_after(0))
    state = (tmp_path / "run" / "state.safetensors").read_bytes()
    monkeypatch.setattr(Run, "_loss", lambda self, batch: torch.tensor(float("nan"), requires_grad=True))
    with pytest.raises(TrainingError, match=r"The loss is nan after \d+ pictures. The last good state is kept"):
        train(data, tmp_path / "run", CONFIG, TINY)
    assert (tmp_path / "run" / "state.safetensors").read_bytes() == state


def test_a_limit_of_time_ends_a_run_with_its_last_stage_done(data, tmp_path):
    seen = []
    train(data, tmp_path / "run", replace(CONFIG, pictures=10_000_000, minutes=0.05), TINY, seen.append)
    assert seen[-1].share == 1
    assert seen[-1].validation.sample_reals is not None
