"""Every setting with its real default; these make the command-line flags and are stored in the checkpoint."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ModelConfig:
    """The network: an image encoder, a first guess from its summary, and a transformer that denoises `x`."""

    encoder: str = "conv"
    """name of a file in encoders/"""
    width: int = 192
    """of every token of the denoiser (the paper's 192)"""
    depth: int = 4
    """blocks of the denoiser (the paper's 12 with DINOv2)"""
    heads: int = 6
    """attention heads of the denoiser (the paper's 6)"""
    summary: int = 512
    """numbers in the pooled feature that the first guess is made from"""


@dataclass(frozen=True)
class TrainConfig:
    """One run of training; `minutes` is the dial, everything else follows it."""

    minutes: float = 60.0
    """of training, after which the best weights are written"""
    batch: int = 64
    """pictures a step"""
    learning_rate: float = 1e-3
    """at its highest; rises for the first 2 % and falls to nothing along a cosine"""
    weight_decay: float = 0.02
    """of AdamW"""
    denoiser_from: float = 0.5
    """share of the time after which the denoiser is trained along with the encoder and its guess"""
    draws: int = 4
    """noise levels per picture; the picture's tokens are computed once for all of them"""
    lock: float = 0.3
    """share of pictures with some parameters given, for `--keep`"""
    ema: float = 0.999
    """decay of the averaged weights that are shipped"""
    repeats: int = 2
    """how often a rendered picture is used, each time with other augmentations"""
    workers: int = 1
    """processes that render"""
    seed: int = 0
    """of everything random"""
    device: str = "auto"
    """cpu, cuda or auto"""
