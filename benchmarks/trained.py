"""Training as users do it, in a process of its own: training forks, which OpenGL survives only unused."""

import subprocess
import sys
from pathlib import Path

from dipcg.data.store import Store


def train(data: str, out: Path, *flags: str) -> Path:
    """The checkpoint of `dipcg train` on a data set with these flags."""
    info = Store(data).info
    words = ["train", info["ref"], "--data", data, "-o", str(out), *flags]
    subprocess.run([sys.executable, "-m", "dipcg", *words], check=True, stdout=subprocess.DEVNULL)
    return out / info["generator"]
