"""DINOv2 ViT-B/14 (Oquab et al. 2023), the encoder of the paper: 256 patch tokens of 768 channels, frozen.

The weights come from a hub or from a folder.
"""

from __future__ import annotations

from torch import nn

from dipcg.config import ModelConfig
from dipcg.encoders._pretrained import PretrainedEncoder, pretrained

# The name of the weights on the hub.
HUB = "facebook/dinov2-base"
# The mean and the standard deviation of the colour channels in ImageNet, with which DINOv2 was trained.
MEAN, DEVIATION = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]


def build(config: ModelConfig) -> nn.Module:
    """The encoder for pictures of 224 pixels a side. Raises RuntimeError when its weights are missing."""
    return PretrainedEncoder(pretrained("Dinov2Model", config.encoder_weights or HUB), config, MEAN, DEVIATION)
