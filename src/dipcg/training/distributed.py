"""Several processes that train one network, started by `accelerate launch -m dipcg train …`: one for each GPU.

Each renders its own pictures; gradients are averaged over all before each step, so their weights stay the same.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor


class Team:
    """The processes of one training; one of them leads: it keeps the time, validates and writes."""

    def __init__(self, device: str) -> None:
        self.size = int(os.environ.get("WORLD_SIZE", "1"))
        self._state = _join(device) if self.size > 1 else None
        self.rank = self._state.process_index if self._state else 0

    @property
    def leads(self) -> bool:
        """Whether this process is the one that writes."""
        return self.rank == 0

    @property
    def device(self) -> torch.device | None:
        """The device of this process, None when it trains alone."""
        return self._state.device if self._state else None

    def average(self, parameters: Iterable[Tensor]) -> None:
        """Replace each gradient by its mean over all processes, in one exchange."""
        if not self._state:
            return
        gradients = [p.grad for p in parameters if p.grad is not None]
        flat = torch.cat([gradient.flatten() for gradient in gradients])
        torch.distributed.all_reduce(flat)
        parts = (flat / self.size).split([gradient.numel() for gradient in gradients])
        for gradient, part in zip(gradients, parts, strict=True):
            gradient.copy_(part.view_as(gradient))

    def agree(self, value: float) -> float:
        """The leader's value, for all."""
        if not self._state:
            return value
        told = torch.tensor([value], dtype=torch.float64, device=self._state.device)
        torch.distributed.broadcast(told, 0)
        return float(told)


def _join(device: str) -> Any:
    """Raises ModuleNotFoundError with the command that helps when accelerate is not installed."""
    try:
        from accelerate import PartialState
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "Several processes need accelerate: run `pip install 'dipcg[train]'`.", name=error.name
        ) from None
    return PartialState(cpu=device == "cpu")
