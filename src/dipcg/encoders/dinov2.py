"""DINOv2 ViT-B/14, the paper's (Oquab et al. 2023): 256 patch tokens of 768 numbers, frozen; from a hub or a folder."""

from __future__ import annotations

from torch import nn

from dipcg.config import ModelConfig
from dipcg.encoders._pretrained import PretrainedEncoder, pretrained

HUB = "facebook/dinov2-base"
MEAN, SPREAD = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]  # ImageNet's


def build(config: ModelConfig) -> nn.Module:
    return PretrainedEncoder(pretrained("Dinov2Model", config.encoder_weights or HUB), config, MEAN, SPREAD)
