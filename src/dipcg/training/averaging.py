"""The moving average of the weights, which is what a checkpoint holds."""

from __future__ import annotations

import torch
from torch import nn
from torch.optim.swa_utils import get_ema_multi_avg_fn


@torch.no_grad()
def average(averaged: nn.Module, network: nn.Module, decay: float, step: int) -> None:
    """Move the averaged weights towards those of the network; in the first steps the decay is lower.

    Otherwise the weights from before the first step would count for too long. Source: Polyak & Juditsky 1992.
    """
    update = get_ema_multi_avg_fn(min(decay, (1 + step) / (10 + step)))
    ours, theirs = averaged.state_dict(), network.state_dict()
    floats = [key for key, value in ours.items() if value.is_floating_point()]
    update([ours[key] for key in floats], [theirs[key] for key in floats], step)
