"""What augmentation is made of: random numbers, masks and blurs, one for each row of a batch."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Generator, Tensor

Views = Float[Tensor, "b 4 s s"]
Pictures = Float[Tensor, "b 3 s s"]
Plane = Float[Tensor, "b 1 s s"]


def some(change: Callable[[Tensor, Generator], Tensor], batch: Tensor, share: float, rng: Generator) -> Tensor:
    """The batch with a change made to a random share of its rows."""
    rows = drawn(batch, share, rng).nonzero().flatten()
    return batch.index_copy(0, rows, change(batch[rows], rng)) if len(rows) else batch


def drawn(batch: Tensor, share: float, rng: Generator) -> Bool[Tensor, " b"]:
    """A random share of the rows."""
    return torch.rand(len(batch), generator=rng, device=batch.device) < share


def between(batch: Tensor, low: float | int, high: float | int, rng: Generator) -> Float[Tensor, "b 1 1 1"]:
    """A uniform number for each row."""
    return torch.rand(len(batch), 1, 1, 1, generator=rng, device=batch.device) * (high - low) + low


def coordinates(batch: Tensor) -> tuple[Float[Tensor, "1 1 1 s"], Float[Tensor, "1 1 s 1"]]:
    """Across and down at the centres of pixels, from -1 to 1."""
    size = batch.shape[-1]
    line = (torch.arange(size, device=batch.device, dtype=batch.dtype) * 2 + 1) / size - 1
    return line[None, None, None], line[None, None, :, None]


def over(views: Views, ground: Float[Tensor, "b c s s"]) -> Pictures:
    """The view over a ground."""
    return torch.lerp(ground.clamp(0, 1).expand_as(views[:, :3]), views[:, :3], views[:, 3:4])


def blobs(views: Views, cells: int, rng: Generator) -> Plane:
    """Smooth noise in [0, 1] with about `cells` bumps along a side."""
    coarse = torch.rand(len(views), 1, cells, cells, generator=rng, device=views.device)
    return F.interpolate(coarse, views.shape[-2:], mode="bicubic", align_corners=False)


def gaussian(batch: Float[Tensor, "b c s s"], low: float, high: float, rng: Generator) -> Float[Tensor, "b c s s"]:
    """Blurred by a Gaussian whose width in pixels is drawn for each row."""
    reach = math.ceil(2.5 * high)
    distance = torch.arange(-reach, reach + 1, device=batch.device, dtype=batch.dtype)
    kernel = (-0.5 * (distance / between(batch, low, high, rng)[:, :, 0]) ** 2).exp()
    kernel = (kernel / kernel.sum(-1, keepdim=True)).expand(-1, batch.shape[1], -1).flatten(0, 1)
    flat = F.pad(batch, [reach] * 4, mode="replicate").flatten(0, 1)[None]
    across = F.conv2d(flat, kernel[:, None, None], groups=len(kernel))
    return F.conv2d(across, kernel[:, None, :, None], groups=len(kernel))[0].unflatten(0, batch.shape[:2])
