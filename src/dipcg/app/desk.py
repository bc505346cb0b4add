"""All that the routes share, and the limits on how much of it is used at once."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterator
from pathlib import Path

import anyio

from dipcg.app.estimating import Estimating
from dipcg.app.jobs import Busy, Jobs
from dipcg.app.limits import MOST_PREVIEWS, MOST_UPLOADING_BYTES
from dipcg.app.making import Making
from dipcg.app.pictures import Pictures
from dipcg.app.studio import Studio
from dipcg.app.trainings import Trainings

# Seconds between two looks for what has been kept too long.
SWEEP_S = 60.0


class Desk:
    """Pictures, jobs and files of all visitors, and who works on them."""

    def __init__(self, studio: Studio, folder: Path, learn: Path | None = None, blender: str = "") -> None:
        self.studio = studio
        self.trainings = Trainings(studio, learn, blender)
        self.pictures, self.jobs = Pictures(), Jobs()
        self.estimating, self.making = Estimating(studio, self.pictures), Making(studio, folder)
        self.previews, self.cut_outs = Budget(MOST_PREVIEWS), Budget(MOST_PREVIEWS)
        self.uploads = Budget(MOST_UPLOADING_BYTES)
        # One picture is decoded at a time, so that no more memory is needed than for one; and two are cut out.
        self.decoding, self.cutting = anyio.CapacityLimiter(1), anyio.CapacityLimiter(2)

    async def sweep_for_ever(self) -> None:
        """Let go what was kept long enough."""
        while True:
            await asyncio.sleep(SWEEP_S)
            for kept in (self.pictures, self.jobs, self.making):
                kept.sweep()

    def close(self) -> None:
        """Stop all work."""
        self.trainings.close()
        self.making.close()
        self.estimating.close()


class Budget:
    """An amount that requests share."""

    def __init__(self, most: int) -> None:
        self._left = most

    @contextlib.contextmanager
    def take(self, amount: int) -> Iterator[None]:
        """Use an amount for a while; raises Busy when not enough is left."""
        if amount > self._left:
            raise Busy
        self._left -= amount
        try:
            yield
        finally:
            self._left += amount
