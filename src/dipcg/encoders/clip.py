"""CLIP ViT-B/16, the paper's ablation (Radford et al. 2021): 196 patch tokens of 768 numbers, frozen."""

from __future__ import annotations

from torch import nn

from dipcg.config import ModelConfig
from dipcg.encoders._pretrained import PretrainedEncoder, pretrained

HUB = "openai/clip-vit-base-patch16"
MEAN, SPREAD = [0.48145466, 0.4578275, 0.40821073], [0.26862954, 0.26130258, 0.27577711]  # CLIP's own


def build(config: ModelConfig) -> nn.Module:
    return PretrainedEncoder(pretrained("CLIPVisionModel", config.encoder_weights or HUB), config, MEAN, SPREAD)
