"""Where trained checkpoints are found, without loading one."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from dipcg import registry

WEIGHTS, CARD = "model.safetensors", "card.json"
# Where `dipcg train` puts checkpoints unless another folder is named.
RUNS = Path("runs")
SHIPPED = Path(__file__).parents[1] / "checkpoints"
# The checkpoints that read text instead of pictures.
WORDS = SHIPPED / "words"

Reads = Literal["pictures", "text"]


class CheckpointError(ValueError):
    """A checkpoint that cannot be used, with a sentence that says why and what to do."""


def shipped(reads: Reads = "pictures") -> list[str]:
    """Names of the generators with a checkpoint in the package."""
    return sorted(card.parent.name for card in _home(reads).glob(f"*/{CARD}"))


def find_checkpoint(name: str, reads: Reads = "pictures") -> Path:
    """The folder of a checkpoint: the path itself, or the one that ships for the generator of this name.

    For the path of a generator's file it is the one that `dipcg train` made for it in this folder. Raises LookupError
    for the name of no generator, and CheckpointError when it has no checkpoint.
    """
    own_file = registry.is_path(name)
    for folder in (RUNS / Path(name).stem,) if own_file else (Path(name), _home(reads) / name):
        if (folder / CARD).is_file():
            return folder
    if "/" not in name and not own_file:
        registry.check("generators", name)
    what, flag = _WORDING[reads]
    raise CheckpointError(
        f"There is no {what} for {name!r} (shipped: {', '.join(shipped(reads)) or 'none'}). "
        f"Make one with `dipcg train {name} --data DIR{flag}`, or give its folder."
    )


# What an error calls such a checkpoint, and the flag that trains one.
_WORDING = {"pictures": ("trained checkpoint", ""), "text": ("checkpoint that reads words", " --encoder sentence")}


def _home(reads: Reads) -> Path:
    return SHIPPED if reads == "pictures" else WORDS
