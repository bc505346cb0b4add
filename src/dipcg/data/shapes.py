"""The shapes of one split of a data set, in memory: what training and evaluation read."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from dipcg.data.shards import MESH
from dipcg.data.store import Store
from dipcg.generators import Generator, load_generator


class Shapes(NamedTuple):
    """The shapes of one split in memory: encoded meshes, and their parameters as `x`."""

    meshes: list[bytes]
    x: Float[np.ndarray, "n p"]
    active: Bool[np.ndarray, "n p"]

    def first(self, count: int) -> Shapes:
        """The first shapes."""
        return Shapes(self.meshes[:count], self.x[:count], self.active[:count])


def load_shapes(folder: str | Path, split: str) -> tuple[Generator, Shapes]:
    """Read the shapes of a split that could be built; raises ValueError when there are none."""
    store = Store(folder)
    rows = [row for row in store.rows(split) if row[MESH]]
    if not rows:
        raise ValueError(f"{folder} has no shapes in its {split} split; build more with `dipcg dataset build`.")
    x = np.stack([store.space.encode(row) for row in rows]).astype(np.float32)
    active = np.stack([store.space.active(row) for row in rows])
    return load_generator(store.info["ref"]), Shapes([row[MESH] for row in rows], x, active)
