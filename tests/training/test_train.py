"""A run: killed, interrupted or starved it ends where an undisturbed one does, and it never goes on with nonsense."""

import signal
import subprocess
import sys
from dataclasses import replace

import pytest
import torch

from dipcg.cli import main
from dipcg.config import ModelConfig, TrainConfig
from dipcg.data.store import build_dataset
from dipcg.generators import load_generator
from dipcg.model.checkpoint import load_checkpoint
from dipcg.model.estimators import build_estimator
from dipcg.training import schedule
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
    # Pictures grow to the 32 pixels of these networks.
    monkeypatch.setattr(schedule, "SMALLEST", 16)
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


def test_the_average_of_the_last_stage_is_not_held_back_by_the_first(data, tmp_path):
    """A short last stage after a long first one: with the average of all steps, what it learnt would not be shipped."""
    box = load_generator("box")
    run = Run(build_estimator(box.space, TINY), replace(CONFIG, pictures=10_000), tmp_path / "run", box)
    run.counters |= {"pictures": 8_000, "step": 5_000, "stage": "guess", "averaged": 5_000}
    batch = training._validation_batch(data, run)
    before = flat(run.model.denoiser)
    for _ in range(12):
        run.learn(batch)
    learnt, averaged = flat(run.model.denoiser) - before, flat(run.averaged.denoiser) - before
    assert float((averaged - learnt).norm()) < 0.5 * float(learnt.norm())
    # Later steps of the stage do not start it anew.
    assert run.counters["averaged"] == 12


def flat(network: torch.nn.Module) -> torch.Tensor:
    return torch.cat([weight.detach().flatten().clone() for weight in network.parameters()])


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


@pytest.mark.parametrize("what", ["loss", "gradient"])
def test_no_number_stops_the_run_keeps_the_last_good_state_and_lower_rates_go_on(data, tmp_path, monkeypatch, what):
    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(data, out, CONFIG, TINY, interrupt_after(0))
    state = (out / "state.safetensors").read_bytes()
    with monkeypatch.context() as patched:
        if what == "loss":
            patched.setattr(Run, "_loss", lambda self, batch: torch.tensor(float("nan"), requires_grad=True))
        else:
            patched.setattr(torch.nn.utils, "clip_grad_norm_", lambda *_: torch.tensor(float("inf")))
        with pytest.raises(TrainingError, match=rf"The {what} is (nan|inf) after \d+ pictures. The last good state is"):
            train(data, out, CONFIG, TINY)
    assert (out / "state.safetensors").read_bytes() == state
    train(data, out, replace(CONFIG, learning_rate=1e-4, matrix_rate=2e-3), TINY)
    assert load_checkpoint(out)[2]["pictures"] == CONFIG.pictures
    with pytest.raises(ValueError, match="batch was 16 and is 8"):
        train(data, out, replace(CONFIG, batch=8), TINY)


def test_a_first_step_without_a_number_leaves_nothing_that_stops_the_next_run(data, tmp_path, monkeypatch, capsys):
    command = ["train", "box", "--data", str(data), "-o", str(tmp_path), "--pictures", "48", "--batch", "16"]
    with monkeypatch.context() as patched:
        patched.setattr(Run, "_loss", lambda self, batch: torch.tensor(float("nan"), requires_grad=True))
        with pytest.raises(SystemExit) as end:
            main(command)
    said = capsys.readouterr()
    assert end.value.code == 1
    assert "The loss is nan after 0 pictures. Nothing is saved; the same command" in said.err
    assert "best weights" not in said.out
    main([*command, "--learning-rate", "1e-4"])
    assert "Wrote the best weights" in capsys.readouterr().out


def test_weights_that_are_no_numbers_are_never_saved(data, tmp_path):
    box = load_generator("box")
    run = Run(build_estimator(box.space, TINY), CONFIG, tmp_path / "run", box)
    with torch.no_grad():
        next(run.model.parameters()).fill_(float("inf"))
    run.save()
    assert not (tmp_path / "run" / "state.safetensors").exists()


def test_a_run_on_other_data_is_not_continued(data, tmp_path):
    build_dataset("box", tmp_path / "other", 40, seed=5)
    with pytest.raises(KeyboardInterrupt):
        train(data, tmp_path / "run", CONFIG, TINY, interrupt_after(0))
    with pytest.raises(ValueError, match=r"data\.seed was 0 and is 5"):
        train(tmp_path / "other", tmp_path / "run", CONFIG, TINY)


STOPPED = """
import sys, threading
from dipcg.cli import main
from dipcg.training import train as training
step = training.Run.learn
training.Run.learn = lambda self, batch: (step(self, batch), print("step", flush=True))[0]
main(["train", "box", "--data", sys.argv[1], "-o", sys.argv[2], "--pictures", "10m", "--image-size", "32"])
"""


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM], ids=lambda stop: stop.name)
def test_a_stopped_command_saves_its_state_and_a_second_one_is_refused_meanwhile(data, tmp_path, capsys, stop):
    command = [sys.executable, "-c", STOPPED, str(data), str(tmp_path)]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert run.stdout.readline() == "step\n"
    with pytest.raises(SystemExit):
        main(["train", "box", "--data", str(data), "-o", str(tmp_path), "--pictures", "10m", "--image-size", "32"])
    assert f"Another process trains in {tmp_path / 'box'}" in capsys.readouterr().err
    run.send_signal(stop)
    said = run.communicate(timeout=60)[1]
    assert run.returncode == 130, said
    assert f"The state is saved in {tmp_path / 'box'}" in said
    assert (tmp_path / "box" / "state.safetensors").is_file()


def test_a_limit_of_time_ends_a_run_with_its_last_stage_done(data, tmp_path):
    seen = []
    train(data, tmp_path / "run", replace(CONFIG, pictures=10_000_000, minutes=0.05), TINY, seen.append)
    assert seen[-1].share == 1
    assert seen[-1].validation.sample_reals is not None
