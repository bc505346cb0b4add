"""Distributed training: one process for each GPU, started by `accelerate launch -m dipcg train …`.

Each process has its own batches. The gradients are averaged over all processes before each step, so that all processes
have the same weights.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor


class Processes:
    """The processes of one training run: `size` of them, of which this one has the number `rank`.

    Rank 0 is the main process, which measures the time, validates and writes. Raises ModuleNotFoundError where there
    are several processes and accelerate is not installed.
    """

    def __init__(self, device: str) -> None:
        self.size = int(os.environ.get("WORLD_SIZE", "1"))
        self._state = _join(device) if self.size > 1 else None
        self.rank = self._state.process_index if self._state else 0

    @property
    def is_main(self) -> bool:
        """Whether this process has rank 0."""
        return self.rank == 0

    @property
    def device(self) -> torch.device | None:
        """The device of this process; None for a single process."""
        return self._state.device if self._state else None

    def average_gradients(self, parameters: Iterable[Tensor]) -> None:
        """Replace the gradient of each parameter by its mean over all processes, in one all-reduce."""
        if not self._state:
            return
        gradients = [p.grad for p in parameters if p.grad is not None]
        flat = torch.cat([gradient.flatten() for gradient in gradients])
        torch.distributed.all_reduce(flat)
        parts = (flat / self.size).split([gradient.numel() for gradient in gradients])
        for gradient, part in zip(gradients, parts, strict=True):
            gradient.copy_(part.view_as(gradient))

    def broadcast(self, value: float) -> float:
        """Broadcast a number from rank 0: return the value of the main process in every process."""
        if not self._state:
            return value
        tensor = torch.tensor([value], dtype=torch.float64, device=self._state.device)
        torch.distributed.broadcast(tensor, 0)
        return float(tensor)


def _join(device: str) -> Any:
    """Join the process group. Raises ModuleNotFoundError with the command that installs accelerate."""
    try:
        from accelerate import PartialState
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "Several processes need accelerate: run `pip install 'dipcg[train]'`.", name=error.name
        ) from None
    return PartialState(cpu=device == "cpu")
