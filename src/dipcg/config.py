"""Every setting with its real default; these make the command-line flags and are stored in the checkpoint."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from tyro.constructors import PrimitiveConstructorSpec


def parse_count(text: str) -> int:
    """A number of things as people write it: 500, 300k, 3m; raises ValueError for anything else or below 1."""
    factor = {"k": 1_000, "m": 1_000_000}.get(text[-1:].lower(), 1)
    try:
        count = round(float(text.rstrip("kKmM")) * factor)
    except ValueError:
        count = 0
    if count < 1:
        raise ValueError(f"A number of pictures is written like 300k or 3m, got {text!r}.")
    return count


Count = Annotated[
    int,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="COUNT",
        instance_from_str=lambda words: parse_count(words[0]),
        is_instance=lambda value: isinstance(value, int),
        str_from_instance=lambda count: [str(count)],
    ),
]


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
    calibration_scale: float = 1.0
    """factor by which samples are moved away from their expectation; `python -m benchmarks calibration` fits it"""

    @property
    def expecting_steps(self) -> int:
        """Steps after which draws average to the expectation: a flow knows it before the first, a ddpm at the end."""
        return 1 if self.objective == "flow" else self.steps


@dataclass(frozen=True)
class AugmentConfig:
    """How often each change is made to a training picture, from 0 (never) to 1 (always)."""

    views: float = 1.0
    """seen from anywhere in the generator's range of views, not from its middle"""
    extreme: float = 0.08
    """seen from far above or from below, beyond the generator's range of views"""
    flip: float = 0.5
    """mirrored, with the camera and the parameters that it then shows"""
    crop: float = 0.7
    """cropped or padded by a few percent"""
    hide: float = 0.12
    """a box in front of the object"""
    eaten: float = 0.1
    """pieces of the object missing, as in a bad cut-out"""
    lost: float = 0.05
    """all missing that has one of the object's own colours"""
    hollow: float = 0.03
    """little left but the outline, as of glass"""
    lines: float = 0.08
    """a line drawing of the surface's folds and ends, as if by hand"""
    mask: float = 0.08
    """the silhouette alone"""
    edges: float = 0.10
    """Canny edges alone"""
    colour: float = 0.8
    """saturation, gamma, tint, contrast and brightness"""
    pale: float = 0.1
    """a pale object, hardly darker than white"""
    background: float = 0.2
    """a ground that is not plain white, sometimes with a shadow"""
    shadow: float = 0.15
    """a soft or hard shadow left on white"""
    floor: float = 0.08
    """a piece of the floor left on white"""
    halo: float = 0.1
    """a rim of the ground's colour left around the object"""
    pieces: float = 0.1
    """pieces of a textured ground left on white, or all of it"""
    beside: float = 0.05
    """a part of another thing left behind or beside the object"""
    blur: float = 0.25
    """out of focus"""
    noise: float = 0.3
    """the grain of a sensor"""
    jpeg: float = 0.2
    """compressed as JPEG"""


@dataclass(frozen=True)
class TrainConfig:
    """One run of training; the number of pictures is the dial that everything else follows."""

    pictures: Count = 1_000_000
    """pictures to learn from, like 300k or 3m; the schedule follows them"""
    minutes: float | int | None = None
    """limit of time; where it comes first, the schedule follows the clock, so that the run ends as it should"""
    start: str = ""
    """checkpoint whose weights it begins with, a name or a folder; weights that do not fit begin at random"""
    shapes: int = 0
    """how many shapes of the data set's train split are used; 0 for all"""
    batch: int = 64
    """pictures in a step"""
    optimiser: Literal["muon", "adamw"] = "muon"
    """muon: orthogonal updates of matrices, AdamW for the rest; adamw: AdamW for all, as in the paper"""
    matrix_rate: float = 0.02
    """the highest learning rate of Muon"""
    learning_rate: float = 1e-3
    """the highest learning rate of AdamW"""
    schedule: Literal["cosine", "constant"] = "cosine"
    """cosine: the rate rises for 2 % of each stage and then falls to a hundredth; constant: as in the paper"""
    weight_decay: float = 0.02
    """weight decay, as a share of the learning rate"""
    grow: bool = True
    """begin with small pictures, which cost less, and end with pictures of the full size"""
    denoiser_share: float = 0.1
    """share of the budget in which the denoiser is trained, on the finished encoder"""
    draws: int = 4
    """noise levels per picture in that share; the picture's tokens are computed once for all of them"""
    lock: float = 0.3
    """share of pictures with some parameters fixed at their true values, which `--keep` needs"""
    pure_noise_fraction: float = 0.125
    """share of the draws that start from pure noise, where the expectation is read"""
    ema: float = 0.999
    """decay of the moving average of the weights, which is what a checkpoint holds"""
    repeats: int = 2
    """how often a sentence is used, for an encoder of sentences"""
    views: Literal["range", "grid"] = "range"
    """range: cameras from anywhere in the generator's range of views; grid: the published cameras"""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    """changes to training pictures"""
    seed: int = 0
    """random seed of the run"""
    device: str = "auto"
    """cpu, cuda or auto"""
    compile: Literal["auto", "yes", "no"] = "auto"
    """fuse the network's operations (torch.compile); auto: on a GPU"""
