"""Encoders: one file each, with `build(config)` that returns a module from pictures or sentences to `Features`.

For pictures the module takes `Float[Tensor, "b 3 s s"]` in [0, 1], the object on white, s = `image_size`. An
encoder of sentences has `image_size` 0. `Features` holds tokens, which the denoiser attends to, and one summary,
from which the first guess is made. A pretrained encoder is no part of a checkpoint: it is held outside the module
tree, so that it is neither trained, nor averaged, nor saved. Its weights come from a hub or from a folder. The
default encoder is a small convolutional network that is trained together with the denoiser and needs no download.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from dipcg import registry
from dipcg.config import ModelConfig
from dipcg.images import over_white


class Features(NamedTuple):
    """The output of an encoder: tokens for the cross-attention of the denoiser, and one summary of each picture."""

    tokens: Float[Tensor, "b t c"]
    summary: Float[Tensor, "b s"]


class Encoder(Protocol):
    """A module from pictures, or from the tokens of sentences, to `Features`."""

    channels: int
    """the number of channels of a token"""
    image_size: int
    """the side of the pictures in pixels; 0 for an encoder of sentences"""

    def __call__(self, images: Float[Tensor, "b 3 s s"]) -> Features: ...


def build_encoder(config: ModelConfig) -> nn.Module:
    """Build the encoder `config.encoder`. Raises LookupError when there is no encoder of this name."""
    return registry.load("encoders", config.encoder).build(config)


def encoder_input(picture: UInt8[np.ndarray, "s s 4"]) -> Float[Tensor, "1 3 s s"]:
    """The input of an encoder from a prepared picture: on white, channels first, in [0, 1]."""
    return torch.from_numpy(over_white(picture)).permute(2, 0, 1)[None].float() / 255


def feature_distance(encoder: nn.Module, photo: UInt8[np.ndarray, "s s 4"]) -> Callable[[np.ndarray], float]:
    """A function from a render to its feature distance from a photo, 1 minus the mean cosine similarity of the tokens.

    Both pictures have the encoder's `image_size` and are cropped to the object. Source: the score of MCMC in the paper
    (section 4.1), which states "feature distance" without a formula; the cosine is our choice.
    """

    @torch.inference_mode()
    def tokens(image: np.ndarray) -> Tensor:
        return encoder(encoder_input(image)).tokens

    encoder.eval()
    target = tokens(photo)
    return lambda render: float(1 - torch.cosine_similarity(tokens(render), target, dim=-1).mean())
