"""Pictures a second in training, and the share of it that making pictures takes."""

import os
import tempfile
from pathlib import Path

from benchmarks.timing import header, machine, row
from dipcg.config import ModelConfig, TrainConfig
from dipcg.data.store import build_dataset
from dipcg.training.train import Status, train

SIZE = int(os.environ.get("DIPCG_BENCH_SIZE", "96"))
MINUTES = float(os.environ.get("DIPCG_BENCH_MINUTES", "1"))


def main() -> None:
    print(machine() + "\n")
    header("stage", "pictures/s", "making pictures")
    with tempfile.TemporaryDirectory() as folder:
        data = Path(os.environ.get("DIPCG_BENCH_DATA", folder))
        if str(data) == folder:
            build_dataset("box", data, 200)
        for phase, share in (("encoder and guess", 0.0), ("denoiser", 0.99)):
            seen: list[Status] = []
            config = TrainConfig(pictures=10**9, minutes=MINUTES, grow=False, denoiser_share=share)
            train(data, Path(folder) / phase, config, ModelConfig(image_size=SIZE), seen.append)
            row(phase, f"{seen[-1].pictures_per_s:.0f}", f"{seen[-1].waiting:.0%}")


if __name__ == "__main__":
    main()
