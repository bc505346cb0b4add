"""Where a network computes, and in which precision."""

from __future__ import annotations

import os
import platform
from functools import cache
from pathlib import Path

import torch

from dipcg.config import TrainConfig
from dipcg.model.estimators import AnyEstimator


def choose_device(name: str) -> torch.device:
    """The named device, or with `auto` the GPU when there is one."""
    return torch.device(("cuda" if torch.cuda.is_available() else "cpu") if name == "auto" else name)


@cache
def has_bfloat16(device: torch.device) -> bool:
    """Whether the device computes in bfloat16 rather than emulating it."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    flags = Path("/proc/cpuinfo")
    return flags.is_file() and any(name in flags.read_text() for name in ("avx512_bf16", "amx_bf16"))


def compile_networks(config: TrainConfig, model: AnyEstimator, device: torch.device) -> None:
    """Fuse operations on a GPU; on a CPU compiled code has a fixed number of threads, which we change while it runs."""
    if config.compile == "yes" or (config.compile == "auto" and device.type == "cuda"):
        model.encoder.compile()
        model.denoiser.compile()


def machine(device: torch.device, processes: int) -> str:
    """The hardware of a run in a few words, for its card."""
    if device.type == "cuda":
        return f"{processes} × {torch.cuda.get_device_name(device)}"
    return f"{os.cpu_count()} cores, {platform.machine()}"
