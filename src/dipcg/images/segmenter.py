"""The segmenter: a small U-Net (Ronneberger et al. 2015) that says how likely each pixel of a photograph is the object.

It has learnt from renders of the generators on random grounds (`python -m benchmarks.segmenter`), and sees the whole
picture at `SIDE` pixels. `photograph.py` takes its answer to the picture's own edges.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Float32, UInt8
from safetensors.torch import load_file
from torch import Tensor, nn

FILE = Path(__file__).parents[1] / "checkpoints" / "segmenter.safetensors"
SIDE = 64
# The channels at a half, a quarter, an eighth and a sixteenth of the side.
CHANNELS = (16, 32, 48, 80)
# Half of the side counts as much as this difference of one colour channel.
NEARNESS = 0.15


class Segmenter(nn.Module):
    """Logits of each pixel of square pictures, whose side is a multiple of 16."""

    def __init__(self) -> None:
        super().__init__()
        # The three colours, where a pixel is, and how far its colour is from those of the border.
        befores = (7, *CHANNELS[:-1])
        self.down = nn.ModuleList(_block(*pair, stride=2) for pair in zip(befores, CHANNELS, strict=True))
        self.whole = nn.Sequential(nn.AdaptiveAvgPool2d(1), nn.Conv2d(CHANNELS[-1], CHANNELS[-1], 1))
        self.up = nn.ModuleList(
            _block(wide + narrow, narrow) for wide, narrow in zip(CHANNELS[:0:-1], CHANNELS[-2::-1], strict=True)
        )
        self.head = nn.Conv2d(CHANNELS[0], 1, 1)

    def forward(self, pictures: Float[Tensor, "b 3 s s"]) -> Float[Tensor, "b 1 s s"]:
        # At half of the side, where it costs an eighth.
        apart = F.interpolate(_from_border(F.avg_pool2d(pictures, 2)), scale_factor=2)
        maps = torch.cat([(pictures - 0.5) * 4, _places(pictures), apart], 1)
        seen = []
        for block in self.down:
            maps = block(maps)
            seen.append(maps)
        maps = maps + self.whole(maps)
        for block, beside in zip(self.up, seen[-2::-1], strict=True):
            maps = block(torch.cat([F.interpolate(maps, scale_factor=2), beside], 1))
        return F.interpolate(self.head(maps), pictures.shape[-2:], mode="bilinear", align_corners=False)


def probability(picture: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
    """How likely each pixel is part of the object."""
    height, width = picture.shape[:2]
    scale = SIDE / max(height, width)
    inner = max(1, round(height * scale)), max(1, round(width * scale))
    small = cv2.resize(picture, inner[::-1], interpolation=cv2.INTER_AREA)
    free = SIDE - inner[0], SIDE - inner[1]
    # What is beside a picture that is not square repeats its edge, as walls and floors go on.
    square = cv2.copyMakeBorder(
        small, free[0] // 2, -(-free[0] // 2), free[1] // 2, -(-free[1] // 2), cv2.BORDER_REPLICATE
    )
    batch = torch.from_numpy(np.ascontiguousarray(square)).permute(2, 0, 1)[None].float() / 255
    with torch.inference_mode():
        # Mirrored, a picture shows the same object.
        logits = _shipped()(torch.cat([batch, batch.flip(-1)]))
        both = (logits[0, 0] + logits[1, 0].flip(-1)) / 2
    top, left = free[0] // 2, free[1] // 2
    found = both.sigmoid().numpy()[top : top + inner[0], left : left + inner[1]]
    return cv2.resize(found, (width, height), interpolation=cv2.INTER_LINEAR)


@cache
def _shipped() -> Segmenter:
    network = Segmenter()
    network.load_state_dict({name: value.float() for name, value in load_file(FILE).items()}, strict=False)
    return network.eval()


def _block(before: int, channels: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, channels, 3, stride, 1, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(),
        nn.Conv2d(channels, channels, 3, 1, 1, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(),
    )


def _places(pictures: Float[Tensor, "b 3 s s"]) -> Float[Tensor, "b 2 s s"]:
    """Across and down, from -1 to 1."""
    line = torch.linspace(-1, 1, pictures.shape[-1], dtype=pictures.dtype)
    return torch.stack(torch.meshgrid(line, line, indexing="xy")).expand(len(pictures), -1, -1, -1)


def _from_border(pictures: Float[Tensor, "b 3 s s"]) -> Float[Tensor, "b 2 s s"]:
    """How far each colour is from the nearest colour of the border, anywhere and weighed with how near that is.

    What is photographed is seldom in a corner and seldom looks like the border (the prior of Wei et al. 2012).
    """
    alone, weighed = pictures.flatten(2).transpose(1, 2), torch.cat([pictures, NEARNESS * _places(pictures)], 1)
    weighed = weighed.flatten(2).transpose(1, 2)
    size = pictures.shape[-1]
    inner = torch.zeros(size, size, dtype=torch.bool)
    inner[1:-1, 1:-1] = True
    border = (~inner).flatten().nonzero()[:, 0]
    distances = [torch.cdist(values, values[:, border]).amin(2) for values in (alone, weighed)]
    return torch.stack(distances, 1).unflatten(2, (size, size)) * 4
