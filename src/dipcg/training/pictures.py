"""Training input of pictures: batches of rendered views, changed at random."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS
from dipcg.config import AugmentConfig
from dipcg.data.shapes import Shapes
from dipcg.generators import Generator
from dipcg.training.augment import augment, flip
from dipcg.training.views import ViewBuffer

# The number of views in memory: 0.5 GB at 128 pixels a side.
SLOTS = 8192
# How many times a rendered view is used on average.
USES = 8


class Batch(NamedTuple):
    """Pictures, what they show as `x` with the camera's numbers, and which parameters count."""

    images: Float[Tensor, "b 3 s s"] | Float[Tensor, "b t c"]
    """in [0, 1]; or the tokens of sentences"""
    x: Float[Tensor, "b d"]
    active: Bool[Tensor, "b p"]


@runtime_checkable
class BatchSource(Protocol):
    """Training input in numbered batches."""

    def batch(self, step: int, size: int) -> Batch:
        """A batch of pictures with `size` pixels a side, in [0, 1]."""
        ...

    def close(self) -> None: ...


class Pictures:
    """Batches of random views of the shapes of one split; a batch depends on the seed and its step alone."""

    def __init__(
        self,
        generator: Generator,
        shapes: Shapes,
        batch: int,
        seed: int = 0,
        config: AugmentConfig | None = None,
        slots: int = SLOTS,
        device: torch.device | None = None,
    ) -> None:
        self.config, self.size, self.seed = config or AugmentConfig(), batch, seed
        self.device = device or torch.device("cpu")
        self.buffer = ViewBuffer(generator, shapes, self.config, slots, seed, self.device)
        self._may_flip = generator.mirrors is not None
        index, sign = generator.mirror_map
        camera = torch.arange(VIEW_NUMBERS)
        self._index = torch.cat([torch.from_numpy(index), len(index) + camera]).to(self.device)
        # A mirrored camera stands at the opposite azimuth, whose sine is the camera's first number.
        self._sign = torch.cat([torch.from_numpy(sign), 1 - 2 * (camera == 0)]).float().to(self.device)

    def batch(self, step: int, size: int) -> Batch:
        """The batch of a step: augmented pictures of `size` pixels a side."""
        self.buffer.advance(self.buffer.slots + (step + 1) * self.size // USES, size)
        rng = torch.Generator(self.device).manual_seed(_seed_of(self.seed, step))
        views, x, active, normals = self.buffer.draw(self.size, rng)
        rows = torch.rand(len(x), generator=rng, device=self.device) < self.config.flip * self._may_flip
        images, x = flip(views.float() / 255, rows), torch.where(rows[:, None], x[:, self._index] * self._sign, x)
        active = torch.where(rows[:, None], active[:, self._index[:-VIEW_NUMBERS]], active)
        return Batch(augment(images, normals, self.config, size, rng), x, active)

    def close(self) -> None:
        """Free the renderer."""
        self.buffer.close()


def _seed_of(seed: int, step: int) -> int:
    return (seed * 1_000_003 + step) % 2**63
