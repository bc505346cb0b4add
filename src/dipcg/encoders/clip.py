"""CLIP ViT-B/16 (Radford et al. 2021), which the paper compares with: 196 patch tokens of 768 channels, frozen.

The weights come from a hub or from a folder.
"""

from __future__ import annotations

from torch import nn

from dipcg.config import ModelConfig
from dipcg.encoders._pretrained import PretrainedEncoder, pretrained

# The name of the weights on the hub.
HUB = "openai/clip-vit-base-patch16"
# CLIP was trained with this mean and this standard deviation of the colour channels.
MEAN, DEVIATION = [0.48145466, 0.4578275, 0.40821073], [0.26862954, 0.26130258, 0.27577711]


def build(config: ModelConfig) -> nn.Module:
    """The encoder for pictures of 224 pixels a side. Raises RuntimeError when its weights are missing."""
    return PretrainedEncoder(pretrained("CLIPVisionModel", config.encoder_weights or HUB), config, MEAN, DEVIATION)
