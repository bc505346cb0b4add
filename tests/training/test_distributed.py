"""Several processes that train one network do what one does with all their pictures."""

import subprocess
import sys

import pytest
import torch

from dipcg.config import ModelConfig, TrainConfig
from dipcg.generators import load_generator
from dipcg.model.estimators import build_estimator
from dipcg.training.pictures import Batch
from dipcg.training.train import Run

SENTENCES = ModelConfig(encoder="sentence", width=16, depth=1, heads=2, summary=16)  # nothing is normalised by batch
STEPS, EACH = 3, 4

SHARE = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_distributed import learn
run = learn(Path(sys.argv[1]))
import torch
torch.save(run.model.state_dict(), f"{sys.argv[1]}/{run.team.rank}.pt")
"""


def learn(out) -> Run:
    """A few steps on this process's share of the same batches."""
    torch.manual_seed(0)
    box = load_generator("box")
    run = Run(build_estimator(box.space, SENTENCES), TrainConfig(device="cpu"), out, box)
    for step in range(STEPS):
        torch.manual_seed(step)
        whole = Batch(torch.randn(2 * EACH, 96, 384), torch.rand(2 * EACH, 12) * 2 - 1, torch.ones(2 * EACH, 8) > 0)
        share = slice(run.team.rank * EACH, (run.team.rank + 1) * EACH) if run.team.size > 1 else slice(None)
        run.learn(Batch(*(part[share] for part in whole)))
    return run


def test_two_processes_learn_what_one_learns_from_all_pictures(tmp_path):
    pytest.importorskip("accelerate")
    (tmp_path / "share.py").write_text(SHARE)
    tests = __file__.rsplit("/", 1)[0]
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc_per_node", "2"]
    done = subprocess.run(
        [*launch, tmp_path / "share.py", tmp_path, tests], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    first, second = (torch.load(tmp_path / f"{rank}.pt") for rank in (0, 1))
    alone = learn(tmp_path).model.state_dict()
    for name, weight in alone.items():
        torch.testing.assert_close(first[name], second[name], rtol=0, atol=0)
        torch.testing.assert_close(first[name], weight, rtol=2e-2, atol=2e-3)
