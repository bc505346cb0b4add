"""The folders of the checkpoints that ship and of those that `dipcg train` writes, without loading one."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from dipcg import registry

# The two files of a checkpoint.
WEIGHTS, CARD = "model.safetensors", "card.json"
# `dipcg train` writes checkpoints here unless another folder is named.
RUNS = Path("runs")
# The checkpoints that ship with the package, one folder for each generator.
SHIPPED = Path(__file__).parents[1] / "checkpoints"
# The shipped checkpoints that take sentences instead of pictures.
WORDS = SHIPPED / "words"

# The input of a checkpoint.
Reads = Literal["pictures", "text"]
# In an error, the words for such a checkpoint, and the flag that trains one.
_WORDING = {"pictures": ("trained checkpoint", ""), "text": ("checkpoint that reads words", " --encoder sentence")}


class CheckpointError(ValueError):
    """A checkpoint that cannot be used, with a sentence that says why and what to do."""


def shipped(reads: Reads = "pictures") -> list[str]:
    """The names of the generators that have a checkpoint in the package."""
    return sorted(card.parent.name for card in _home(reads).glob(f"*/{CARD}"))


def find_checkpoint(name: str, reads: Reads = "pictures") -> Path:
    """The folder of a checkpoint: the shipped one of the generator `name`, or else `name` itself if it is one.

    A folder that is called like a generator needs a slash, such as ./chair. For the path of a generator's file it is
    the folder that `dipcg train` writes for this file by default. Raises LookupError for an unknown generator, and
    CheckpointError when the generator has no checkpoint.
    """
    folder = _folder(name, reads)
    if (folder / CARD).is_file():
        return folder
    if "/" not in name and not registry.is_path(name):
        registry.check("generators", name)
    what, flag = _WORDING[reads]
    raise CheckpointError(
        f"There is no {what} for {name!r} (shipped: {', '.join(shipped(reads)) or 'none'}). "
        f"Make one with `dipcg train {name} --data DIR{flag}`, or give its folder."
    )


def _folder(name: str, reads: Reads) -> Path:
    if registry.is_path(name):
        return RUNS / Path(name).stem
    return _home(reads) / name if name in registry.names("generators") else Path(name)


def _home(reads: Reads) -> Path:
    return SHIPPED if reads == "pictures" else WORDS
