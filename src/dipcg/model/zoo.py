"""Where trained checkpoints are found, without loading one."""

from __future__ import annotations

from pathlib import Path

from dipcg import registry

WEIGHTS, CARD = "model.safetensors", "card.json"
RUNS = Path("runs")  # where `dipcg train` puts checkpoints when it is told no other folder
SHIPPED = Path(__file__).parents[1] / "checkpoints"
WORDS = SHIPPED / "words"  # those that read sentences instead of pictures


class CheckpointError(ValueError):
    """A checkpoint that cannot be used, with a sentence that says why and what to do."""


def shipped() -> list[str]:
    """Names of the generators with a checkpoint in the package."""
    return sorted(card.parent.name for card in SHIPPED.glob(f"*/{CARD}"))


def find_checkpoint(name: str) -> Path:
    """The folder of a checkpoint: the path itself, or the one that ships for the generator of this name.

    For the path of a generator it is the one that `dipcg train` made of it in this folder.

    Raises LookupError for the name of no generator, CheckpointError when it has no checkpoint.
    """
    own_file = registry.is_path(name)
    for folder in (RUNS / Path(name).stem,) if own_file else (Path(name), SHIPPED / name):
        if (folder / CARD).is_file():
            return folder
    if "/" not in name and not own_file:
        registry.check("generators", name)
    trained = ", ".join(shipped()) or "none"
    raise CheckpointError(
        f"There is no trained checkpoint for {name!r} (shipped: {trained}). "
        f"Make one with `dipcg train {name} --data DIR`, or give its folder."
    )


def find_words(name: str) -> Path:
    """The folder of a checkpoint that reads sentences: the path itself, or the one that ships for a generator.

    Raises LookupError for the name of no generator, CheckpointError when it has none.
    """
    for folder in (Path(name), WORDS / name):
        if (folder / CARD).is_file():
            return folder
    if not registry.is_path(name) and "/" not in name:
        registry.check("generators", name)
    trained = ", ".join(sorted(card.parent.name for card in WORDS.glob(f"*/{CARD}"))) or "none"
    raise CheckpointError(
        f"There is no checkpoint that reads words for {name!r} (shipped: {trained}). "
        f"Make one with `dipcg train {name} --data DIR --encoder sentence`, or give its folder."
    )
