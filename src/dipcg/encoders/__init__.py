"""What an encoder is: a file with `build(config)` returning a module from pictures to `Features`, and `image_size`.

The module takes `Float[Tensor, "b 3 s s"]` in [0, 1], the object on white, s = `image_size`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from jaxtyping import Float
from torch import Tensor, nn

from dipcg import registry
from dipcg.config import ModelConfig


class Features(NamedTuple):
    """What the denoiser sees of a picture: tokens to attend to and one summary of all."""

    tokens: Float[Tensor, "b t c"]
    summary: Float[Tensor, "b s"]


class Encoder(Protocol):
    """A module with the number of channels of its tokens and the side of the pictures it wants."""

    channels: int
    image_size: int

    def __call__(self, images: Float[Tensor, "b 3 s s"]) -> Features: ...


def build_encoder(config: ModelConfig) -> nn.Module:
    """Build the encoder that the configuration names; raises LookupError for an unknown one."""
    return registry.load("encoders", config.encoder).build(config)
