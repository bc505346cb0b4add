"""Muon: momentum whose matrices are made orthogonal, so that every direction of a layer learns at the same rate.

Source: Jordan et al. 2024, "Muon: An optimizer for hidden layers in neural networks", with the coefficients given
there. A convolution's filters are one matrix, a row for each output channel. Vectors, first and last layers have no
such directions; AdamW updates them.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dipcg.config import TrainConfig
from dipcg.model.estimators import AnyEstimator
from dipcg.training.device import has_bfloat16

MOMENTUM = 0.95
# The quintic polynomial of a Newton-Schulz step, whose repetition moves all singular values near 1.
COEFFICIENTS = (3.4445, -4.7750, 2.0315)
STEPS = 5
# A matrix that is wider than this many times its height is orthogonalised by way of its square, which is less work.
WIDE = 1.5
# A weight with fewer inputs or outputs has too few directions.
LEAST_SIDE = 32


class Muon(torch.optim.Optimizer):
    """Updates of matrices and filters by their orthogonalised momentum."""

    def __init__(self, parameters: Iterable[Tensor], lr: float = 0.02, weight_decay: float = 0.0) -> None:
        super().__init__(parameters, {"lr": lr, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]
        """Update every parameter that has a gradient; those of one shape together."""
        for group in self.param_groups:
            shaped = sorted((p for p in group["params"] if p.grad is not None), key=lambda p: tuple(p.shape))
            for _, same in groupby(shaped, key=lambda p: tuple(p.shape)):
                self._update(list(same), group["lr"], group["weight_decay"])

    def _update(self, parameters: list[Tensor], lr: float, weight_decay: float) -> None:
        updates = orthogonal(torch.stack([self._direction(p).flatten(1) for p in parameters]))
        # A tall matrix has fewer directions than rows, and its update is made as large as that of a square one.
        scale = lr * max(1.0, updates.shape[1] / updates.shape[2]) ** 0.5
        for parameter, update in zip(parameters, updates, strict=True):
            parameter.mul_(1 - lr * weight_decay).sub_(update.view_as(parameter), alpha=scale)

    def _direction(self, parameter: Tensor) -> Tensor:
        """Nesterov's momentum."""
        assert parameter.grad is not None
        state = self.state[parameter]
        if "momentum" not in state:
            state["momentum"] = torch.zeros_like(parameter)
        state["momentum"].lerp_(parameter.grad, 1 - MOMENTUM)
        return parameter.grad.lerp(state["momentum"], MOMENTUM)


def orthogonal(matrices: Float[Tensor, "n r c"]) -> Float[Tensor, "n r c"]:
    """Each matrix with its singular vectors and all singular values near 1, by Newton-Schulz steps."""
    in_bfloat16 = has_bfloat16(matrices.device)
    x = matrices.bfloat16() if in_bfloat16 else matrices
    tall = x.shape[1] > x.shape[2]
    x = x.mT if tall else x
    x = x / (x.norm(dim=(1, 2), keepdim=True) + 1e-7)
    wide = x.shape[2] > WIDE * x.shape[1]
    x = _newton_schulz_of_squares(x) if wide and not in_bfloat16 else _newton_schulz(x)
    return (x.mT if tall else x).to(matrices.dtype)


def _newton_schulz(x: Float[Tensor, "n r c"]) -> Float[Tensor, "n r c"]:
    a, b, c = COEFFICIENTS
    for _ in range(STEPS):
        square = x @ x.mT
        x = a * x + (b * square + c * square @ square) @ x
    return x


def _newton_schulz_of_squares(x: Float[Tensor, "n r c"]) -> Float[Tensor, "n r c"]:
    """The same steps on the small squares of wide matrices, whose polynomials commute; bfloat16 is too coarse."""
    square = x @ x.mT
    product = polynomial = _polynomial(square)
    for _ in range(STEPS - 1):
        square = polynomial @ square @ polynomial
        polynomial = _polynomial(square)
        product = polynomial @ product
    return product @ x


def _polynomial(square: Float[Tensor, "n r r"]) -> Float[Tensor, "n r r"]:
    """What one step multiplies a matrix with, from its square."""
    a, b, c = COEFFICIENTS
    one = torch.eye(square.shape[1], device=square.device, dtype=square.dtype)
    return a * one + b * square + c * square @ square


def matrices(network: nn.Module) -> list[Tensor]:
    """The weights of a network's linear layers and convolutions that have enough inputs and outputs to be matrices."""
    layers = (module for module in network.modules() if isinstance(module, (nn.Linear, nn.Conv2d)))
    return [layer.weight for layer in layers if min(len(layer.weight), layer.weight[0].numel()) >= LEAST_SIDE]


def make_optimisers(model: AnyEstimator, config: TrainConfig) -> dict[str, torch.optim.Optimizer]:
    """Muon for the matrices of encoder and denoiser, AdamW for all else; AdamW alone where it is configured."""
    inner = [*matrices(model.encoder), *matrices(model.denoiser)] if config.optimiser == "muon" else []
    others = [p for p in model.parameters() if all(p is not matrix for matrix in inner)]
    decay = config.weight_decay
    found: dict[str, torch.optim.Optimizer] = {}
    found["adamw"] = torch.optim.AdamW(others, config.learning_rate, (0.9, 0.98), weight_decay=decay, fused=True)
    if inner:
        found["muon"] = Muon(inner, config.matrix_rate, decay)
    return found
