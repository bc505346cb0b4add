"""What a run does at each share of its budget: the stage, the size of pictures, the learning rate.

The budget is a number of pictures, so a run that is starved, paused or resumed ends where an undisturbed one does. A
limit in minutes makes the schedule follow the clock where that is further on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dipcg.config import TrainConfig

# Pictures grow in these steps: from a share of the first stage on, they have this share of their final size. They have
# it early, because a network needs a high learning rate to get used to larger pictures.
GROWTH = ((0.0, 0.5), (0.2, 0.75), (0.4, 1.0))
# Sizes are rounded to this many pixels, the step of the conv encoder's last map.
STEP = 16
# Smaller pictures than this do not show thin parts; networks for smaller ones do not grow.
SMALLEST = 64
# The share of a stage in which the learning rate rises.
WARM_UP = 0.02
# The lowest learning rate, as a share of the highest.
LEAST_RATE = 0.01


@dataclass(frozen=True)
class Schedule:
    """The plan of one run; `two_stages` when the encoder is trained by its direct guess before the denoiser is."""

    config: TrainConfig
    image_size: int
    two_stages: bool
    grows: bool

    def share(self, pictures: int, elapsed_s: float | int) -> float:
        """How much of the budget is spent, from 0 to 1."""
        limit = self.config.minutes
        spent = elapsed_s / (60 * limit) if limit else 0.0
        return min(1.0, max(pictures / self.config.pictures, spent))

    def trains_denoiser(self, share: float) -> bool:
        """Whether the denoiser is trained now, on an encoder that stays as it is when there are two stages."""
        return not self.two_stages or share >= self._boundary

    def size(self, share: float) -> int:
        """The side of training pictures in pixels."""
        if not self.grows:
            return self.image_size
        progress = self._progress(share) if share < self._boundary else 1.0
        factor = [part for start, part in GROWTH if progress >= start][-1]
        return max(min(SMALLEST, self.image_size), STEP * round(factor * self.image_size / STEP))

    def rate(self, share: float) -> float:
        """The learning rate as a share of the highest: a rise and half a cosine for each stage, or always 1."""
        if self.config.schedule == "constant":
            return 1.0
        progress = self._progress(share)
        cosine = (1 + math.cos(math.pi * progress)) / 2
        return min(1.0, progress / WARM_UP) * (LEAST_RATE + (1 - LEAST_RATE) * cosine)

    @property
    def _boundary(self) -> float:
        return 1 - self.config.denoiser_share if self.two_stages else 1.0

    def _progress(self, share: float) -> float:
        """The share of the present stage that is over."""
        if share < self._boundary:
            return share / self._boundary
        return (share - self._boundary) / (1 - self._boundary) if self._boundary < 1 else 1.0
