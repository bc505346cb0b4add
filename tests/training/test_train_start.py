"""Training that starts with the weights of another checkpoint."""

from pathlib import Path

import pytest
import torch

from dipcg.config import ModelConfig, TrainConfig
from dipcg.generators import load_generator
from dipcg.model.checkpoint import save_checkpoint
from dipcg.model.estimators import build_estimator
from dipcg.model.zoo import CheckpointError
from dipcg.training.train import Run

TINY = ModelConfig(width=16, depth=1, heads=2, summary=16)


def run_from(folder: Path, out: Path, generator: str, model: ModelConfig = TINY) -> Run:
    loaded = load_generator(generator)
    torch.manual_seed(1)
    return Run(build_estimator(loaded.space, model), TrainConfig(start=str(folder), device="cpu"), out, loaded)


@pytest.fixture
def saved(tmp_path) -> tuple[Path, dict[str, torch.Tensor]]:
    torch.manual_seed(0)
    box = load_generator("box")
    model = build_estimator(box.space, TINY)
    save_checkpoint(tmp_path / "first", model, box, {"pictures": 100, "started_from": {"pictures": 20}})
    return tmp_path / "first", model.state_dict()


@pytest.mark.slow
@pytest.mark.parametrize("generator", ["box", "table"])
def test_a_run_starts_with_all_weights_that_fit(saved, tmp_path, generator):
    folder, weights = saved
    run = run_from(folder, tmp_path / "out", generator)
    for state in (run.model.state_dict(), run.averaged.state_dict()):
        fitting = [key for key in state if key in weights and weights[key].shape == state[key].shape]
        assert any(key.startswith("encoder.") for key in fitting)
        assert (len(fitting) == len(state)) == (generator == "box")
        # The checkpoint has half precision.
        for key in fitting:
            torch.testing.assert_close(state[key], weights[key], atol=2e-3, rtol=2e-3)


def test_a_run_notes_the_checkpoint_that_it_started_from(saved, tmp_path):
    assert run_from(saved[0], tmp_path / "out", "table").about["started_from"] == {
        "checkpoint": "first",
        "pictures": 120,
    }


def test_a_start_with_another_encoder_or_without_a_checkpoint_is_refused(saved, tmp_path):
    with pytest.raises(CheckpointError, match="has the encoder 'conv' and this network has 'sentence': start from"):
        run_from(
            saved[0], tmp_path / "out", "box", ModelConfig(encoder="sentence", width=16, depth=1, heads=2, summary=16)
        )
    with pytest.raises(CheckpointError, match="no trained checkpoint"):
        run_from(tmp_path / "nothing.toml", tmp_path / "out", "box")
