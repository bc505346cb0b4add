"""Pictures a second in training, and the share of a step that waits for pictures."""

import os
import tempfile
from pathlib import Path

from benchmarks.timing import header, machine, row
from dipcg.config import ModelConfig, TrainConfig
from dipcg.data.store import build_dataset
from dipcg.training.train import Status, train

MINUTES = float(os.environ.get("DIPCG_BENCH_MINUTES", "1"))


def main() -> None:
    print(machine() + "\n")
    header("phase", "pictures/s", "waiting for pictures")
    with tempfile.TemporaryDirectory() as folder:
        data = Path(os.environ.get("DIPCG_BENCH_DATA", folder))
        if str(data) == folder:
            build_dataset("box", data, 200)
        for phase, begin in (("encoder and guess", 2.0), ("with the denoiser", 0.0)):
            seen: list[Status] = []
            config = TrainConfig(minutes=MINUTES, denoiser_from=begin)
            train(data, Path(folder) / phase, config, ModelConfig(), seen.append)
            row(phase, f"{seen[-1].pictures_per_s:.0f}", f"{seen[-1].waiting:.0%}")


if __name__ == "__main__":
    main()
