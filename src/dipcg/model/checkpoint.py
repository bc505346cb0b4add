"""Checkpoints on disk: a folder with the weights as safetensors and a card as JSON, never a pickle."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from dipcg.config import ModelConfig
from dipcg.files import written
from dipcg.generators import Generator, load_generator
from dipcg.model.estimators import AnyEstimator, build_estimator
from dipcg.model.zoo import CARD, WEIGHTS, CheckpointError
from dipcg.space import ParameterSpace

# Settings that had another name in the cards of version 0.1.0.
RENAMED = {"widen": "calibration_scale"}


def save_checkpoint(folder: str | Path, model: AnyEstimator, generator: Generator, about: dict[str, Any]) -> None:
    """Write the weights of an estimator in half precision, and a card.

    The card holds the generator, its parameter space, the configuration of the network and the entries of `about`.
    """
    write_checkpoint(folder, model.state_dict(), model.config, generator, about)


def write_checkpoint(
    folder: str | Path, weights: Mapping[str, Tensor], config: ModelConfig, generator: Generator, about: dict[str, Any]
) -> None:
    """Write a checkpoint as `save_checkpoint` does, from the weights and the configuration of a network."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    halves = {k: v.half() if v.is_floating_point() else v for k, v in weights.items()}
    card = {
        "generator": generator.name,
        "ref": generator.ref,
        "fingerprint": generator.space.fingerprint,
        "model": asdict(config),
        **about,
        "space": generator.space.describe(),
    }
    # Both are replaced together, so that a card is never that of other weights.
    with written(folder / CARD) as unfinished:
        unfinished.with_name(WEIGHTS).write_bytes(save({k: v.contiguous() for k, v in halves.items()}))
        unfinished.write_text(json.dumps(card, indent=1))


def load_checkpoint(folder: str | Path) -> tuple[AnyEstimator, Generator, dict[str, Any]]:
    """Read a checkpoint and return its estimator in evaluation mode, its generator and its card.

    Raises CheckpointError when it is missing, damaged, or made for other parameters than the generator has now, and
    LookupError when the generator is unknown.
    """
    folder = Path(folder)
    card = _read_card(folder)
    generator = load_generator(card["ref"])
    _check_space(generator.space, card, folder)
    model = build_estimator(generator.space, _model_config(card["model"]))
    _load_weights(model, folder / WEIGHTS)
    return model.eval(), generator, card


def load_matching(model: AnyEstimator, folder: str | Path) -> int:
    """Load the weights of another checkpoint that have the same name and shape as in `model`.

    Returns the number of pictures that these weights were trained on, with those of the checkpoint that they started
    from. Raises CheckpointError when the checkpoint is missing or damaged, or has another encoder.
    """
    folder = Path(folder)
    card, weights = _read_card(folder), _read_weights(folder / WEIGHTS)
    other = card["model"]["encoder"]
    if other != model.config.encoder:
        raise CheckpointError(
            f"{folder} has the encoder {other!r} and this network has {model.config.encoder!r}: "
            "start from a checkpoint with the same encoder."
        )
    fitting = {k: weights[k] for k, v in model.state_dict().items() if k in weights and weights[k].shape == v.shape}
    model.load_state_dict(fitting, strict=False)
    return int(card.get("pictures", 0)) + int(card.get("started_from", {}).get("pictures", 0))


def _model_config(settings: dict[str, Any]) -> ModelConfig:
    """The configuration of a card, also of one that was written by version 0.1.0."""
    return ModelConfig(**{RENAMED.get(key, key): value for key, value in settings.items()})


def _read_card(folder: Path) -> dict[str, Any]:
    try:
        card = json.loads((folder / CARD).read_text())
        return {key: card[key] for key in ("generator", "ref", "fingerprint", "model", "space")} | card
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"{folder} is not a checkpoint: its {CARD} cannot be read ({error}).") from None


def _load_weights(model: AnyEstimator, path: Path) -> None:
    weights = _read_weights(path)
    try:
        model.load_state_dict(weights)
    except RuntimeError as error:
        raise _damaged(path, error) from None


def _read_weights(path: Path) -> dict[str, Tensor]:
    try:
        return {k: v.float() if v.is_floating_point() else v for k, v in load_file(path).items()}
    except (OSError, SafetensorError, RuntimeError) as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> CheckpointError:
    reason = str(error).splitlines()[0]
    return CheckpointError(f"The weights in {path} are damaged or cut short ({reason}); get them again.")


def _check_space(space: ParameterSpace, card: dict[str, Any], folder: Path) -> None:
    if space.fingerprint == card["fingerprint"]:
        return
    now, then = ({p["name"]: p for p in described} for described in (space.describe(), card["space"]))
    changed = sorted(name for name in now.keys() | then.keys() if now.get(name) != then.get(name))
    raise CheckpointError(
        f"The checkpoint {folder} was trained for other parameters of {card['generator']!r}: "
        f"{', '.join(changed) or 'their order'} differ. Train it again with `dipcg train`."
    )
