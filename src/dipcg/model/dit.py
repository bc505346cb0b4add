"""The paper's network: a transformer with one token for each parameter and cross-attention to the picture's tokens.

Sources: Peebles & Xie 2023 (DiT), with one modulation for all blocks as in PixArt-α (Chen et al. 2023); the paper,
section 3.2. Shapes: `b` rows, `n` parameters, `m` tokens of the picture with `c` channels.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from dipcg.config import ModelConfig
from dipcg.model.ddpm import STEPS
from dipcg.model.denoiser import Block, KeysValues, sinusoids


class DiT(nn.Module):
    """Predicts the noise in `x` and the fraction of its log variance (`ddpm.Predict`); both are 0 before training."""

    position: Tensor

    def __init__(self, parameters: int, channels: int, config: ModelConfig) -> None:
        super().__init__()
        w = config.width
        self.enter = nn.Linear(1, w)
        self.register_buffer("position", positions(parameters, w))
        self.project = nn.Sequential(nn.Linear(channels, w), nn.GELU(approximate="tanh"), nn.Linear(w, w))
        self.time = nn.Sequential(nn.Linear(256, w), nn.SiLU(), nn.Linear(w, w))
        self.modulation = nn.Sequential(nn.SiLU(), nn.Linear(w, 6 * w))
        self.blocks = nn.ModuleList(Block(w, config.heads) for _ in range(config.depth))
        self.shift = nn.Parameter(torch.randn(2, 1, w) / w**0.5)
        self.norm = nn.LayerNorm(w, elementwise_affine=False)
        self.leave = nn.Linear(w, 2)
        nn.init.zeros_(self.leave.weight)
        nn.init.zeros_(self.leave.bias)
        # Published weights were trained with DiT's epsilon, which is smaller than torch's default.
        for layer in self.modules():
            if isinstance(layer, nn.LayerNorm):
                layer.eps = 1e-6

    def keys_values(self, tokens: Float[Tensor, "b m c"]) -> KeysValues:
        """The keys and values of each block's cross-attention, which are the same at every step."""
        projected = self.project(tokens)
        return [block.cross.keys_values(projected) for block in self.blocks]  # type: ignore[union-attr]

    def forward(
        self, x: Float[Tensor, "b n"], t: Int[Tensor, " b"], keys_values: KeysValues
    ) -> tuple[Float[Tensor, "b n"], Float[Tensor, "b n"]]:
        """The predicted noise and the fraction of its log variance, from `x` at the step `t` of the 1000."""
        hidden = self.enter(x[..., None]) + self.position
        signal = self.time(sinusoids(t / STEPS, 256))
        modulation = self.modulation(signal).unflatten(1, (6, 1, -1))
        for block, pair in zip(self.blocks, keys_values, strict=True):
            hidden = block(hidden, modulation, pair)
        shift, scale = (self.shift + signal[:, None, None]).unbind(1)
        noise, fraction = self.leave(self.norm(hidden) * (1 + scale) + shift).unbind(-1)
        return noise, fraction


def positions(count: int, width: int) -> Float[Tensor, "{count} {width}"]:
    """The position embedding of each token: sines, then cosines, of its index (Vaswani et al. 2017, section 3.5)."""
    angles = torch.arange(count)[:, None] / 10_000 ** (torch.arange(width // 2) / (width // 2))
    return torch.cat([angles.sin(), angles.cos()], 1)
