"""The published way of sampling against ours, at the same number of weights, on random features of the same size.

The picture's features are given in both: the encoder runs once in either. On a busy machine threads wait for each other
and count that as work: DIPCG_BENCH_THREADS=1 keeps the ratio honest.
"""

import os
import time
from collections.abc import Callable

import numpy as np
import torch
from torch import nn

from benchmarks.timing import header, machine, row
from dipcg.camera import VIEW_NUMBERS
from dipcg.config import ModelConfig
from dipcg.encoders import Features
from dipcg.generators import load_generator
from dipcg.model import ddpm
from dipcg.model.denoiser import Denoiser, Outputs
from dipcg.model.dit import DiT
from dipcg.pipeline import EXPECTED_OVER
from dipcg.training.recipes import RECIPES

SPACE = load_generator("chair").space
# The tokens of DINOv2 and their channels.
TOKENS, CHANNELS = 256, 768
REPEATS = int(os.environ.get("DIPCG_BENCH_REPEATS", "3"))
SAMPLES = int(os.environ.get("DIPCG_BENCH_SAMPLES", "1"))


@torch.inference_mode()
def main() -> None:
    torch.manual_seed(0)
    torch.set_num_threads(int(os.environ.get("DIPCG_BENCH_THREADS", torch.get_num_threads())))
    print(
        f"{machine()}, {torch.get_num_threads()} threads; "
        f"{len(SPACE)} parameters, {TOKENS} image tokens, {SAMPLES} samples at once\n"
    )
    published = DiT(len(SPACE), CHANNELS, RECIPES["paper"].model).eval()
    same_size = Denoiser(Outputs(SPACE), ModelConfig(depth=12), CHANNELS).eval()
    shipped = Denoiser(Outputs(SPACE), ModelConfig(), CHANNELS).eval()
    rows = [
        ("published: 250 DDPM steps, all recomputed", published, lambda n: _published(published, n, every_step=True)),
        ("published, keys and values once", published, lambda n: _published(published, n, every_step=False)),
        ("ours at the same size, 16 steps", same_size, lambda n: _ours(same_size, n, 16)),
        ("ours at the same size, 10 steps", same_size, lambda n: _ours(same_size, n, 10)),
        ("ours at the same size, the expectation", same_size, lambda n: _ours(same_size, n * EXPECTED_OVER, 1)),
        ("ours as shipped (4 blocks), 10 steps", shipped, lambda n: _ours(shipped, n, 10)),
        ("ours as shipped, the expectation", shipped, lambda n: _ours(shipped, n * EXPECTED_OVER, 1)),
    ]
    header("sampling", "million weights", "wall s", "core s", "fewer core s")
    first = 0.0
    for what, network, work in rows:
        wall, core = _timed(work)
        first = first or core
        row(what, f"{_weights(network) / 1e6:.2f}", f"{wall:.3f}", f"{core:.3f}", f"{first / core:.0f} ×")


def _timed(work: Callable[[int], object]) -> tuple[float, float]:
    """Median wall seconds, and core seconds, which a busy machine changes less."""
    work(SAMPLES)
    taken = []
    for _ in range(REPEATS):
        wall, core = time.perf_counter(), time.process_time()
        work(SAMPLES)
        taken.append((time.perf_counter() - wall, time.process_time() - core))
    wall, core = np.median(taken, axis=0).tolist()
    return wall, core


def _published(network: DiT, samples: int, every_step: bool) -> torch.Tensor:
    tokens = torch.randn(samples, TOKENS, CHANNELS)
    once = network.keys_values(tokens)

    def predict(x: torch.Tensor, t: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return network(x, t, network.keys_values(tokens) if every_step else once)

    return ddpm.sample(predict, torch.randn(samples, len(SPACE)), 250)


def _ours(network: Denoiser, samples: int, steps: int) -> torch.Tensor:
    features = Features(torch.randn(1, TOKENS, CHANNELS), torch.randn(1, ModelConfig().summary))
    condition = network.condition(features, torch.zeros(1, network.outputs.numbers)).repeat(samples)
    x = torch.randn(samples, len(SPACE) + VIEW_NUMBERS)
    given = torch.zeros_like(x, dtype=torch.bool)
    for step in range(steps):
        mean = network(x, torch.full((samples,), step / steps), given, condition).mean
        x = torch.lerp(x, mean, 1 / (steps - step))
    return x


def _weights(network: nn.Module) -> int:
    return sum(weight.numel() for weight in network.parameters())


if __name__ == "__main__":
    main()
