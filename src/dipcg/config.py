"""Every setting with its real default; these make the command-line flags and are stored in the checkpoint."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class ModelConfig:
    """The network: an image encoder, a first guess from its summary, and a transformer that denoises `x`."""

    encoder: str = "conv"
    """name of a file in encoders/"""
    image_size: int = 128
    """side of the pictures that the conv encoder sees, a multiple of 16; the pretrained ones have their own"""
    width: int = 192
    """of every token of the denoiser (the paper's 192)"""
    depth: int = 4
    """blocks of the denoiser (the paper's 12 with DINOv2)"""
    heads: int = 6
    """attention heads of the denoiser (the paper's 6)"""
    summary: int = 512
    """numbers in the pooled feature that the first guess is made from; 0 for the paper's model, which has none"""
    encoder_weights: str = ""
    """hub name or folder of a pretrained encoder's weights; the encoder's own when empty"""
    objective: Literal["flow", "ddpm"] = "flow"
    """flow: the clean end is predicted, from a first guess; ddpm: the noise is, as in the paper"""
    steps: int = 10
    """of the sampler, where no other number is asked for (the paper's 250)"""
    widen: float = 1.0
    """how many times farther from the expectation samples are put than drawn; benchmarks.calibration fits it"""

    @property
    def expecting_steps(self) -> int:
        """Steps after which draws average to the expectation: a flow knows it before the first, a ddpm at the end."""
        return 1 if self.objective == "flow" else self.steps


@dataclass(frozen=True)
class AugmentConfig:
    """How often each change is made to a training picture, from 0 (never) to 1 (always)."""

    views: float = 1.0
    """seen from anywhere in the generator's range of views, not from its middle"""
    lines: float = 0.08
    """a line drawing made from the surface's normals, as if by hand"""
    mask: float = 0.08
    """the silhouette alone"""
    edges: float = 0.10
    """Canny edges alone"""
    colour: float = 0.8
    """saturation, gamma, tint, contrast and brightness"""
    background: float = 0.25
    """a ground that is not plain white, sometimes with a shadow"""
    crop: float = 0.7
    """cropped or padded by a few percent"""
    hide: float = 0.12
    """a piece of the object hidden"""
    blur: float = 0.25
    """out of focus"""
    noise: float = 0.3
    """the grain of a sensor"""
    jpeg: float = 0.2
    """compressed as JPEG"""
    flip: float = 0.5
    """mirrored, with the camera and the parameters that it then shows"""


@dataclass(frozen=True)
class TrainConfig:
    """One run of training; `minutes` is the dial, everything else follows it."""

    minutes: float = 60.0
    """of training, after which the best weights are written"""
    start: str = ""
    """checkpoint whose weights it begins with, a name or a folder; what does not fit begins at random"""
    shapes: int = 0
    """of the data set's train split, its first so many; 0 for all"""
    batch: int = 64
    """pictures a step"""
    learning_rate: float = 1e-3
    """at its highest"""
    schedule: Literal["cosine", "constant"] = "cosine"
    """cosine: rises for the first 2 % of the time and then falls to nothing; constant: as in the paper"""
    weight_decay: float = 0.02
    """of AdamW"""
    denoiser_from: float = 0.5
    """share of the time after which the denoiser is trained along with the encoder and its guess"""
    draws: int = 4
    """noise levels per picture; the picture's tokens are computed once for all of them"""
    lock: float = 0.3
    """share of pictures with some parameters given, for `--keep`"""
    first: float = 0.125
    """share of the draws that are pure noise, where the answer is read: the expectation before the first step"""
    ema: float = 0.999
    """decay of the averaged weights that are shipped"""
    repeats: int = 2
    """how often a rendered picture is used, each time with other augmentations"""
    views: Literal["range", "grid"] = "range"
    """range: seen from anywhere in the generator's range of views; grid: from the published cameras"""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    """changes to training pictures"""
    workers: int = 1
    """processes that render"""
    seed: int = 0
    """of everything random"""
    device: str = "auto"
    """cpu, cuda or auto"""
    compile: Literal["auto", "yes", "no"] = "auto"
    """fuse the network's operations (torch.compile); auto: on a GPU, and in a long run where there is a C++ compiler"""
