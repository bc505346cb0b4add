"""The default encoder: a small residual network, trained together with the denoiser, that needs no download."""

from __future__ import annotations

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from dipcg.config import ModelConfig
from dipcg.encoders import Features

# The channels and the number of blocks at a quarter, an eighth and a sixteenth of the picture's side.
STAGES = ((64, 2), (128, 2), (192, 2))
# The last map is pooled to a grid of this side, so that pictures of all sizes give the same number of tokens.
GRID = 8


def build(config: ModelConfig) -> nn.Module:
    """The encoder for pictures of `config.image_size` pixels a side. Raises ValueError for no multiple of 16."""
    if config.image_size < 16 or config.image_size % 16:
        raise ValueError(f"The image size of the conv encoder is a multiple of 16, got {config.image_size}.")
    return ConvEncoder(config.summary, config.image_size)


class ConvEncoder(nn.Module):
    """A ResNet (He et al. 2016) of three stages.

    The 64 cells of its last map are the tokens, and a projection of the whole map is the summary.
    """

    # Training may use pictures of other sizes than `image_size`.
    any_size = True

    channels = STAGES[-1][0]

    def __init__(self, summary: int, image_size: int) -> None:
        super().__init__()
        self.image_size = image_size
        layers: list[nn.Module] = [nn.Conv2d(3, 32, 3, 2, 1, bias=False), nn.BatchNorm2d(32), nn.ReLU()]
        before = 32
        for channels, blocks in STAGES:
            layers += [_Block(before if i == 0 else channels, channels, 2 if i == 0 else 1) for i in range(blocks)]
            before = channels
        self.body = nn.Sequential(*layers)
        squeeze = nn.Conv2d(before, 32, 1)
        self.pool = nn.Sequential(
            squeeze, nn.Flatten(), nn.Linear(32 * GRID**2, summary), nn.LayerNorm(summary), nn.GELU()
        )

    def forward(self, images: Float[Tensor, "b 3 s s"]) -> Features:
        maps = F.adaptive_avg_pool2d(self.body((images - 0.5) * 4), GRID)
        return Features(maps.flatten(2).transpose(1, 2), self.pool(maps))


class _Block(nn.Module):
    """The basic residual block of He et al. 2016, with pooling in the skip connection of a block with a stride."""

    def __init__(self, before: int, channels: int, stride: int) -> None:
        super().__init__()
        self.first = nn.Sequential(
            nn.Conv2d(before, channels, 3, stride, 1, bias=False), nn.BatchNorm2d(channels), nn.ReLU()
        )
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels))
        self.skip: nn.Module = nn.Identity()
        if stride > 1:
            self.skip = nn.Sequential(
                nn.AvgPool2d(stride), nn.Conv2d(before, channels, 1, bias=False), nn.BatchNorm2d(channels)
            )

    def forward(self, maps: Tensor) -> Tensor:
        return (self.skip(maps) + self.second(self.first(maps))).relu()
