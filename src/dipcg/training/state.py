"""What a killed run goes on from, in one file: weights, their average, the optimisers and the counters."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save
from torch import Tensor, nn

from dipcg.config import TrainConfig
from dipcg.files import write_file

# The parts of a configuration, such as that of the network, each with its settings.
Settings = dict[str, dict[str, Any]]

WEIGHTS = "state.safetensors"
# A resumed run may change these: they decide how long and where it computes, not what it learns.
FREE = ("pictures", "minutes", "device", "compile")
# A run whose loss was no number leaves this file, and may then go on at other rates.
FAILED, RATES = "failed.txt", ("learning_rate", "matrix_rate")


def save_state(
    folder: Path,
    networks: dict[str, nn.Module],
    optimisers: dict[str, torch.optim.Optimizer],
    counters: dict[str, Any],
    settings: Settings,
) -> None:
    """Write the state and the settings of the run; one that is killed while it writes keeps the state of before."""
    tensors = {f"{name}.{k}": v for name, network in networks.items() for k, v in network.state_dict().items()}
    for name, optimiser in optimisers.items():
        for index, entry in optimiser.state_dict()["state"].items():
            tensors |= {f"{name}.{index}.{k}": torch.as_tensor(v) for k, v in entry.items()}
    about = counters | settings
    # The counters are in the same file, so that no kill leaves them of another moment than the weights.
    write_file(folder / WEIGHTS, save({k: v.contiguous() for k, v in tensors.items()}, {"state": json.dumps(about)}))
    (folder / FAILED).unlink(missing_ok=True)


def load_state(
    folder: Path, networks: dict[str, nn.Module], optimisers: dict[str, torch.optim.Optimizer], settings: Settings
) -> dict[str, Any]:
    """Read the state into networks and optimisers, and return the counters; none where there is no state.

    Raises ValueError that lists the differences when the folder holds a run with other settings.
    """
    if not (folder / WEIGHTS).is_file():
        return {}
    counters = _read_counters(folder / WEIGHTS)
    # A state of version 0.1.0 does not say on which data it was trained.
    before = {part: counters.pop(part) for part in settings if part in counters}
    _check_same(folder, before, {part: settings[part] for part in before})
    tensors = load_file(folder / WEIGHTS)
    for name, network in networks.items():
        network.load_state_dict(_under(f"{name}.", tensors))
    for name, optimiser in optimisers.items():
        _load_optimiser(optimiser, _under(f"{name}.", tensors))
    return counters


def allow_lower_rates(folder: Path, what: str, config: TrainConfig) -> str:
    """Note in a folder what has stopped its run, so that it may go on at other rates; returns what to do as well."""
    there = (folder / WEIGHTS).is_file()
    rates = f"--learning-rate {config.learning_rate / 10:g} --matrix-rate {config.matrix_rate / 10:g}"
    kept = f"The last good state is kept in {folder}, and" if there else "Nothing is saved;"
    said = f"{what} {kept} the same command goes on with lower rates, such as {rates}."
    if there:
        write_file(folder / FAILED, said)
    return said


def saved(folder: Path) -> str:
    """A sentence that says how far the saved state is."""
    if not (folder / WEIGHTS).is_file():
        return f"No step was done, so nothing is saved in {folder}."
    return f"The state is saved in {folder}, after {_read_counters(folder / WEIGHTS)['pictures']:,} pictures."


def _read_counters(path: Path) -> dict[str, Any]:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, "pt") as file:
            return json.loads(file.metadata()["state"])
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"The state in {path} cannot be read ({error}); delete it to start anew.") from None


def _check_same(folder: Path, before: Settings, now: Settings) -> None:
    free = FREE + RATES if (folder / FAILED).is_file() else FREE
    theirs, ours = ({k: v for part in s.values() for k, v in _flat(part) if k not in free} for s in (before, now))
    changed = sorted(key for key in ours.keys() | theirs.keys() if ours.get(key) != theirs.get(key))
    if changed:
        words = ", ".join(f"{key} was {theirs.get(key)!r} and is {ours.get(key)!r}" for key in changed)
        raise ValueError(
            f"{folder} holds a run with other settings: {words}. Give the same settings, choose another folder with "
            "-o, or delete it."
        )


def _flat(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Settings by their names, and those of a group as GROUP.NAME, as JSON values."""
    for key, value in json.loads(json.dumps(settings)).items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}


def _load_optimiser(optimiser: torch.optim.Optimizer, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        index, name = key.split(".", 1)
        state.setdefault(int(index), {})[name] = value
    optimiser.load_state_dict(optimiser.state_dict() | {"state": state})
