"""What a killed run goes on from, in one file: weights, their average, the optimisers and the counters."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save
from torch import Tensor, nn

from dipcg.config import ModelConfig, TrainConfig
from dipcg.files import write_file

WEIGHTS = "state.safetensors"
# A resumed run may change these: they decide how long and where it computes, not what it learns.
FREE = ("pictures", "minutes", "device", "compile")


def save_state(
    folder: Path,
    networks: dict[str, nn.Module],
    optimisers: dict[str, torch.optim.Optimizer],
    counters: dict[str, Any],
    config: tuple[ModelConfig, TrainConfig],
) -> None:
    """Write the state; a run that is killed while it writes keeps the state of before."""
    tensors = {f"{name}.{k}": v for name, network in networks.items() for k, v in network.state_dict().items()}
    for name, optimiser in optimisers.items():
        for index, entry in optimiser.state_dict()["state"].items():
            tensors |= {f"{name}.{index}.{k}": torch.as_tensor(v) for k, v in entry.items()}
    about = counters | {"model": asdict(config[0]), "train": asdict(config[1])}
    # The counters are in the same file, so that no kill leaves them of another moment than the weights.
    write_file(folder / WEIGHTS, save({k: v.contiguous() for k, v in tensors.items()}, {"state": json.dumps(about)}))


def load_state(
    folder: Path,
    networks: dict[str, nn.Module],
    optimisers: dict[str, torch.optim.Optimizer],
    config: tuple[ModelConfig, TrainConfig],
    device: torch.device,
) -> dict[str, Any]:
    """Read the state into networks and optimisers, and return the counters; none where there is no state.

    Raises ValueError with a sentence when the folder holds a run with another configuration.
    """
    if not (folder / WEIGHTS).is_file():
        return {}
    counters = _read_counters(folder / WEIGHTS)
    _check_same(folder, counters.pop("model"), counters.pop("train"), config)
    tensors = load_file(folder / WEIGHTS, device=str(device))
    for name, network in networks.items():
        network.load_state_dict(_under(f"{name}.", tensors))
    for name, optimiser in optimisers.items():
        _load_optimiser(optimiser, _under(f"{name}.", tensors))
    return counters


def _read_counters(path: Path) -> dict[str, Any]:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, "pt") as file:
            return json.loads(file.metadata()["state"])
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"The state in {path} cannot be read ({error}); delete it to start anew.") from None


def _check_same(
    folder: Path, model: dict[str, Any], train: dict[str, Any], config: tuple[ModelConfig, TrainConfig]
) -> None:
    ours = _essence(asdict(config[0]), asdict(config[1]))
    theirs = _essence(model, train)
    changed = sorted(key for key in ours.keys() | theirs.keys() if ours.get(key) != theirs.get(key))
    if changed:
        words = ", ".join(f"{key} was {theirs.get(key)!r} and is {ours.get(key)!r}" for key in changed)
        raise ValueError(
            f"{folder} holds a run with other settings: {words}. Give the same settings, choose another folder with "
            "-o, or delete it."
        )


def _essence(model: dict[str, Any], train: dict[str, Any]) -> dict[str, Any]:
    """The settings that decide what is learnt, in one flat dict of JSON values."""
    flat = {**model, **train.pop("augment", {}), **train}
    return json.loads(json.dumps({key: value for key, value in flat.items() if key not in FREE}))


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}


def _load_optimiser(optimiser: torch.optim.Optimizer, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        index, name = key.split(".", 1)
        state.setdefault(int(index), {})[name] = value
    optimiser.load_state_dict(optimiser.state_dict() | {"state": state})
