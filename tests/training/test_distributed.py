"""Distributed training: several processes give the weights of one process with all their pictures, and go on later."""

import subprocess
import sys

import pytest
import torch

from dipcg.config import ModelConfig, TrainConfig
from dipcg.generators import load_generator
from dipcg.model.estimators import build_estimator
from dipcg.training.pictures import Batch
from dipcg.training.train import Run

# The encoder of sentences has no batch normalisation, whose statistics would differ between processes.
SENTENCES = ModelConfig(encoder="sentence", width=16, depth=1, heads=2, summary=16)
# The number of steps, and the batch size of each process.
STEPS, BATCH = 3, 4

SHARE = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_distributed import STEPS, again, learn
run = learn(Path(sys.argv[1]))
if run.processes.is_main:
    run.save()
run.processes.broadcast(0.0)
assert again(Path(sys.argv[1])).counters["step"] == STEPS
import torch
torch.save(run.model.state_dict(), f"{sys.argv[1]}/{run.processes.rank}.pt")
"""


def learn(out) -> Run:
    """Train for a few steps on the share of this process in batches that are the same for all processes."""
    torch.manual_seed(0)
    run = again(out)
    for step in range(STEPS):
        torch.manual_seed(step)
        whole = Batch(torch.randn(2 * BATCH, 96, 384), torch.rand(2 * BATCH, 12) * 2 - 1, torch.ones(2 * BATCH, 8) > 0)
        share = (
            slice(run.processes.rank * BATCH, (run.processes.rank + 1) * BATCH)
            if run.processes.size > 1
            else slice(None)
        )
        run.learn(Batch(*(part[share] for part in whole)))
    return run


def again(out) -> Run:
    """The run in a folder, as it was saved."""
    box = load_generator("box")
    return Run(build_estimator(box.space, SENTENCES), TrainConfig(device="cpu"), out, box)


def test_two_processes_train_the_same_weights_as_one_and_go_on_where_they_were(tmp_path):
    pytest.importorskip("accelerate")
    (tmp_path / "share.py").write_text(SHARE)
    tests = __file__.rsplit("/", 1)[0]
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc_per_node", "2"]
    done = subprocess.run(
        [*launch, tmp_path / "share.py", tmp_path, tests], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    first, second = (torch.load(tmp_path / f"{rank}.pt") for rank in (0, 1))
    alone = learn(tmp_path / "alone").model.state_dict()
    for name, weight in alone.items():
        torch.testing.assert_close(first[name], second[name], rtol=0, atol=0)
        torch.testing.assert_close(first[name], weight, rtol=2e-2, atol=2e-3)
