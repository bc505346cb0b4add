"""The denoiser of the default objective: a transformer with one token for each entry of `x`, and its outputs.

In this file `x` holds the parameters and the four numbers of the camera (`camera.encode_view`), which are denoised
together. Shapes: `b` rows, `d` entries of `x`, `k` options of all choices, `n` = d + k raw outputs, `t` tokens of the
encoder with `c` channels, `s` numbers in its summary, `w` channels in the denoiser.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from dipcg.camera import VIEW_NUMBERS
from dipcg.config import ModelConfig
from dipcg.encoders import Features
from dipcg.space import Choice, ParameterSpace

# The keys and values of the cross-attention, one pair for each block.
KeysValues = list[tuple[Tensor, Tensor]]


@dataclass(frozen=True)
class Prediction:
    """A prediction of the clean `x`: the expectation of each entry, and a logit for each option of each choice."""

    mean: Float[Tensor, "b d"]
    logits: Float[Tensor, "b k"]


@dataclass(frozen=True)
class Condition:
    """The input of the denoiser that depends on the picture alone and is computed once for all steps."""

    keys_values: KeysValues
    summary: Float[Tensor, "b w"]
    guess: Float[Tensor, "b n"]
    """raw outputs of the first guess"""

    def repeat(self, times: int) -> Condition:
        """The condition with each row repeated `times` times, the copies of a row next to each other."""
        pairs = [(k.repeat_interleave(times, 0), v.repeat_interleave(times, 0)) for k, v in self.keys_values]
        return Condition(pairs, self.summary.repeat_interleave(times, 0), self.guess.repeat_interleave(times, 0))


class Outputs(nn.Module):
    """Turns raw outputs into a `Prediction`: tanh bounds real parameters, and a softmax gives the options of a choice.

    An option of a choice stands for an interval of [-1, 1]. `centres` has the centre of the interval of each option,
    `owner` the index in `x` of each option's choice, `is_choice` which entries of `x` are choices, and `numbers` is
    the number of raw outputs.
    """

    centres: Tensor
    owner: Tensor
    is_choice: Tensor

    def __init__(self, space: ParameterSpace) -> None:
        super().__init__()
        self.dimension = len(space) + VIEW_NUMBERS
        choices = [(i, p) for i, p in enumerate(space) if isinstance(p, Choice)]
        centres = [centre for _, p in choices for centre in p.centres]
        owner = [i for i, p in choices for _ in p.options]
        chosen = torch.zeros(self.dimension, dtype=torch.bool)
        chosen[[i for i, _ in choices]] = True
        self.register_buffer("centres", torch.tensor(centres, dtype=torch.float32), persistent=False)
        self.register_buffer("owner", torch.tensor(owner, dtype=torch.long), persistent=False)
        self.register_buffer("is_choice", chosen, persistent=False)
        self.numbers = self.dimension + len(owner)

    def forward(self, raw: Float[Tensor, "b n"]) -> Prediction:
        """The prediction from raw outputs: `d` numbers for the entries of `x`, then `k` logits."""
        raw = raw.float()
        real, logits = torch.tanh(raw[:, : self.dimension]), raw[:, self.dimension :]
        return Prediction(torch.where(self.is_choice, self.expect(logits), real), logits)

    def expect(self, logits: Float[Tensor, "b k"]) -> Float[Tensor, "b d"]:
        """The expectation of each choice as an entry of `x`, and 0 for the other entries."""
        return self._sum(self.log_probabilities(logits).exp() * self.centres)

    def log_probabilities(self, logits: Float[Tensor, "b k"]) -> Float[Tensor, "b k"]:
        """The log softmax of the logits over the options of each choice."""
        highest = logits.new_full((len(logits), self.dimension), -torch.inf)
        highest = highest.scatter_reduce_(1, self.owner.expand_as(logits), logits.detach(), "amax")
        logits = logits - highest[:, self.owner]
        return logits - self._sum(logits.exp()).clamp_min(1e-30).log()[:, self.owner]

    def modes(self, prediction: Prediction) -> Float[Tensor, "b d"]:
        """The most probable option of each choice and the expectation of each other entry of `x`."""
        x = prediction.mean.clone()
        for i in self.owner.unique().tolist():
            options = (self.owner == i).nonzero().flatten()
            x[:, i] = self.centres[options][prediction.logits[:, options].argmax(1)]
        return x

    def choice_targets(self, x: Float[Tensor, "b d"]) -> Float[Tensor, "b k"]:
        """The one-hot targets of the choices: 1 for the option whose interval contains `x`, 0 for the others."""
        width = 2 / self._sum(torch.ones_like(self.centres)[None]).clamp_min(1)[:, self.owner]
        # The margin keeps a value on the border of two intervals from being in both after rounding.
        return ((x[:, self.owner] - self.centres).abs() < width / 2 - 1e-6).float()

    def _sum(self, values: Float[Tensor, "b k"]) -> Float[Tensor, "b d"]:
        """The sum over the options of each choice, and 0 for the other entries of `x`."""
        return values.new_zeros(len(values), self.dimension).index_add_(1, self.owner, values)


class Denoiser(nn.Module):
    """A diffusion transformer with cross-attention that predicts a correction of the first guess.

    Its output is added to the raw outputs of the first guess and is 0 before training. Sources: the paper, equation 2;
    Peebles & Xie 2023; adaLN-single of PixArt-α (Chen et al. 2023).
    """

    def __init__(self, outputs: Outputs, config: ModelConfig, channels: int) -> None:
        super().__init__()
        d, w = outputs.dimension, config.width
        self.outputs, self.heads = outputs, config.heads
        # Weights of the three inputs of each token: noisy value, first guess, and whether the value is fixed.
        self.scale = nn.Parameter(torch.randn(3, d, w) * 0.5)
        self.offset = nn.Parameter(torch.randn(d, w) * 0.5)
        self.project = nn.Sequential(nn.Linear(channels, w), nn.GELU(approximate="tanh"), nn.Linear(w, w))
        self.summary = nn.Linear(config.summary, w)
        self.time = nn.Sequential(nn.Linear(256, w), nn.SiLU(), nn.Linear(w, w))
        self.modulation = nn.Sequential(nn.SiLU(), nn.Linear(w, 6 * w))
        self.blocks = nn.ModuleList(Block(w, config.heads) for _ in range(config.depth))
        self.norm = nn.LayerNorm(w)
        self.read = nn.Parameter(torch.zeros(d, w))
        self.read_options = nn.Parameter(torch.zeros(len(outputs.owner), w))

    def condition(self, features: Features, guess: Float[Tensor, "b n"]) -> Condition:
        """The condition of a picture from the features of the encoder and the raw outputs of the first guess."""
        tokens = self.project(features.tokens)
        pairs = [block.cross.keys_values(tokens) for block in self.blocks]  # type: ignore[union-attr]
        return Condition(pairs, self.summary(features.summary), guess)

    def forward(
        self, x: Float[Tensor, "b d"], t: Float[Tensor, " b"], fixed_mask: Bool[Tensor, "b d"], condition: Condition
    ) -> Prediction:
        """Predict the clean `x` from the noisy `x` at time `t` (0 noise, 1 clean).

        The entries under `fixed_mask` have their clean values at every time.
        """
        inputs = torch.stack([x, self.outputs(condition.guess).mean, fixed_mask.to(x.dtype)], -1)
        hidden = torch.einsum("bdi,idw->bdw", inputs, self.scale) + self.offset
        signal = self.time(sinusoids(t, 256)) + condition.summary
        modulation = self.modulation(signal).unflatten(1, (6, 1, -1))
        for block, pair in zip(self.blocks, condition.keys_values, strict=True):
            hidden = block(hidden, modulation, pair)
        hidden = self.norm(hidden).float()
        real = (hidden * self.read).sum(-1)
        options = (hidden[:, self.outputs.owner] * self.read_options).sum(-1)
        return self.outputs(condition.guess + torch.cat([real, options], 1))


class Block(nn.Module):
    """Self-attention among the tokens, cross-attention to the picture and an MLP, modulated by time and summary."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.shift = nn.Parameter(torch.randn(6, 1, width) / width**0.5)
        self.norms = nn.ModuleList(nn.LayerNorm(width, elementwise_affine=False) for _ in range(2))
        self.attend, self.cross = Attention(width, heads), Attention(width, heads)
        self.mlp = nn.Sequential(nn.Linear(width, 4 * width), nn.GELU(approximate="tanh"), nn.Linear(4 * width, width))

    def forward(self, hidden: Tensor, modulation: Tensor, keys_values: tuple[Tensor, Tensor]) -> Tensor:
        shift_a, scale_a, gate_a, shift_m, scale_m, gate_m = (modulation + self.shift).unbind(1)
        inner = self.norms[0](hidden) * (1 + scale_a) + shift_a
        hidden = hidden + gate_a * self.attend(inner, self.attend.keys_values(inner))
        hidden = hidden + self.cross(hidden, keys_values)
        return hidden + gate_m * self.mlp(self.norms[1](hidden) * (1 + scale_m) + shift_m)


class Attention(nn.Module):
    """Multi-head attention whose keys and values can be computed before the queries."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.queries, self.pairs = nn.Linear(width, width), nn.Linear(width, 2 * width)
        self.output = nn.Linear(width, width)

    def keys_values(self, tokens: Float[Tensor, "b t w"]) -> tuple[Tensor, Tensor]:
        """The keys and the values of the tokens, each of shape `b heads t w/heads`."""
        keys, values = self.pairs(tokens).chunk(2, -1)
        return self._split(keys), self._split(values)

    def forward(self, hidden: Float[Tensor, "b d w"], keys_values: tuple[Tensor, Tensor]) -> Float[Tensor, "b d w"]:
        mixed = attend(self._split(self.queries(hidden)), *keys_values)
        return self.output(mixed.transpose(1, 2).flatten(2))

    def _split(self, tokens: Tensor) -> Tensor:
        return tokens.unflatten(2, (self.heads, -1)).transpose(1, 2)


def attend(queries: Tensor, keys: Tensor, values: Tensor) -> Tensor:
    """Scaled dot-product attention (Vaswani et al. 2017, section 3.2); all shapes are `b heads tokens channels`."""
    # On a CPU the backward pass of the fused kernel in bfloat16 is slower than that of plain matrix products.
    if queries.is_cuda or not torch.is_grad_enabled():
        return F.scaled_dot_product_attention(queries, keys, values)
    scores = (queries * queries.shape[-1] ** -0.5) @ keys.transpose(-2, -1)
    return scores.softmax(-1).to(values.dtype) @ values


def sinusoids(t: Float[Tensor, " b"], width: int) -> Float[Tensor, "b {width}"]:
    """Cosines, then sines, of a time in [0, 1] at `width` / 2 frequencies (Vaswani et al. 2017, section 3.5)."""
    rates = torch.exp(-math.log(10_000) * torch.arange(width // 2, device=t.device) / (width // 2))
    angles = 1000 * t[:, None].float() * rates
    return torch.cat([angles.cos(), angles.sin()], 1)
