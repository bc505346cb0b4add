"""JPEG's loss on whole batches: blocks of 8 × 8, a cosine transform, and the quantisation tables of its annex K.

Source: ITU-T T.81 (1992), tables K.1 and K.2; colours are not subsampled.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Generator, Tensor

BLOCK = 8
# The lowest and the highest quality that is drawn, as libjpeg counts it.
QUALITY = (25, 90)
LUMINANCE = (
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
CHROMINANCE = (
    (17, 18, 24, 47, 99, 99, 99, 99),
    (18, 21, 26, 66, 99, 99, 99, 99),
    (24, 26, 56, 99, 99, 99, 99, 99),
    (47, 66, 99, 99, 99, 99, 99, 99),
    *((99,) * 8,) * 4,
)
TO_YCC = ((0.299, 0.587, 0.114), (-0.1687, -0.3313, 0.5), (0.5, -0.4187, -0.0813))


def compress(pictures: Float[Tensor, "b 3 s s"], rng: Generator) -> Float[Tensor, "b 3 s s"]:
    """Each picture as it is after writing and reading it as JPEG of a random quality."""
    size, to_ycc = pictures.shape[-1], pictures.new_tensor(TO_YCC)
    quality = torch.empty(len(pictures), device=pictures.device).uniform_(*QUALITY, generator=rng)
    tables = _tables(quality, pictures)
    missing = -size % BLOCK
    padded = F.pad(pictures, [0, missing, 0, missing], mode="replicate") * 255 - 128
    blocks = _blocks(torch.einsum("kc,bchw->bkhw", to_ycc, padded))
    transform = _cosines().to(pictures)
    waves = transform @ blocks @ transform.T
    waves = (waves / tables).round() * tables
    decoded = torch.einsum("kc,bchw->bkhw", to_ycc.inverse(), _whole(transform.T @ waves @ transform, padded.shape[-1]))
    return ((decoded + 128) / 255).clamp(0, 1)[..., :size, :size]


def _tables(quality: Float[Tensor, " b"], like: Tensor) -> Float[Tensor, "b 3 1 1 8 8"]:
    """The quantisation tables of each picture: libjpeg's scaling of annex K."""
    scale = torch.where(quality < 50, 5000 / quality, 200 - 2 * quality) / 100
    tables = like.new_tensor([LUMINANCE, CHROMINANCE, CHROMINANCE])[None, :, None, None]
    return (tables * scale[:, None, None, None, None, None]).round().clamp(1, 255)


def _blocks(planes: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c m n 8 8"]:
    return planes.unfold(2, BLOCK, BLOCK).unfold(3, BLOCK, BLOCK)


def _whole(blocks: Float[Tensor, "b c m n 8 8"], size: int) -> Float[Tensor, "b c {size} {size}"]:
    return blocks.transpose(3, 4).reshape(*blocks.shape[:2], size, size)


def _cosines() -> Float[Tensor, "8 8"]:
    """The orthonormal matrix of the discrete cosine transform (type II)."""
    index = torch.arange(BLOCK)
    waves = torch.cos(math.pi / BLOCK * (index[None] + 0.5) * index[:, None])
    return waves * torch.where(index[:, None] == 0, math.sqrt(1 / BLOCK), math.sqrt(2 / BLOCK))
