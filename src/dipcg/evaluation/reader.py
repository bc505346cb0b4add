"""A reader who makes no mistake about what a picture shows: how near an estimate of that picture can come."""

from __future__ import annotations

from contextlib import closing

import numpy as np
from jaxtyping import UInt8

from dipcg.camera import View
from dipcg.images import MARGIN
from dipcg.mesh import Mesh
from dipcg.pipeline import Inverter
from dipcg.render import Renderer
from dipcg.space import Params

# Side of the pictures that are compared.
SIDE = 128
# Two pictures are the same when fewer than this share of the object's pixels differ by more than this in any channel.
SHARE, LEVELS = 0.005, 16
# A choice that is replaced may make other parameters active, which the next round replaces.
ROUNDS = 2


def perfect_reading(inverter: Inverter, truth: Params, view: View, guess: Params) -> Params | None:
    """The true parameters, with those of the guess wherever they leave the picture from this camera as it is.

    They are replaced one after the other, in the order of the space. None when the truth cannot be built.
    """
    space = inverter.generator.space
    with closing(Renderer(SIDE)) as renderer:

        def picture(params: Params) -> UInt8[np.ndarray, "s s 4"] | None:
            built = next(inverter.pool.map([params], "light"))
            return renderer.render(built, view, margin=MARGIN) if isinstance(built, Mesh) else None

        shown, read = picture(truth), truth
        if shown is None:
            return None
        for name in space.names * ROUNDS:
            tried = space.replace(read, {name: guess[name]})
            if tried != read and (seen := picture(tried)) is not None and _same(seen, shown):
                read = tried
    return read


def _same(one: UInt8[np.ndarray, "s s 4"], other: UInt8[np.ndarray, "s s 4"]) -> bool:
    differs = (np.abs(one.astype(int) - other.astype(int)) > LEVELS).any(-1)
    return bool(differs.sum() < SHARE * (other[..., 3] > 0).sum())
