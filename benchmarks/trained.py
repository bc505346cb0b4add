"""Training as users do it: commands of dipcg in processes of their own, which may be killed and repeated."""

import subprocess
import sys
from pathlib import Path

from dipcg.data.store import Store


def train(data: str, out: Path, *flags: str) -> Path:
    """The checkpoint of `dipcg train` on a data set with these flags; a finished run is left as it is."""
    info = Store(data).info
    run("train", info["ref"], "--data", data, "-o", str(out), *flags)
    return out / info["generator"]


def run(*words: str) -> None:
    """Run one command of dipcg, which goes on where it was; a training that is finished is left as it is."""
    done = subprocess.run([sys.executable, "-m", "dipcg", *words], capture_output=True, text=True)
    if done.returncode and "is finished" not in done.stderr:
        raise SystemExit(done.stderr)
