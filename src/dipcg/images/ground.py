"""The ground of a picture as its border shows it: a colour that changes slowly from place to place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from dipcg.images.read import RGBA

Lab = Float32[np.ndarray, "h w 3"]

# Pixels of the border farther than this from the fitted colour, in CIELAB, are taken for something else than ground.
OUTLIER = 10.0
# Up to this difference a border has one colour, which needs no fit.
SAME = 2.0
ROUNDS = 4


class Ground(NamedTuple):
    """How far each pixel is from the ground's colour in CIELAB, and the same for the pixels of the border."""

    lab: Lab
    colour: Lab
    distance: Float32[np.ndarray, "h w"]
    border: Float32[np.ndarray, " n"]


def to_lab(image: RGBA) -> Lab:
    """The colours in CIELAB."""
    import cv2

    return cv2.cvtColor(image[..., :3].astype(np.float32) / 255, cv2.COLOR_RGB2LAB)


def border_of(values: np.ndarray) -> np.ndarray:
    """The pixels of the border, one after the other."""
    return np.concatenate([values[0], values[-1], values[1:-1, 0], values[1:-1, -1]])


def find_ground(image: RGBA) -> Ground:
    """Fit a polynomial of second degree in place to each channel of the border, without what is no ground there.

    A wall that grows darker to one side, or a picture whose corners are darker, has no single colour.
    """
    lab = to_lab(image)
    terms = _terms(*lab.shape[:2])
    seen, places = border_of(lab), border_of(terms)
    colour = np.broadcast_to(np.median(seen, axis=0), lab.shape).astype(np.float32)
    one_colour = (np.linalg.norm(seen - border_of(colour), axis=1) < SAME).mean() > 0.8
    for _ in range(0 if one_colour else ROUNDS):
        near = np.linalg.norm(seen - border_of(colour), axis=1) < OUTLIER
        if near.mean() < 0.5:
            break
        weights = np.linalg.lstsq(places[near], seen[near], rcond=None)[0]
        # Far inside, nothing holds the polynomial.
        low, high = seen[near].min(0), seen[near].max(0)
        colour = (terms @ weights).clip(2 * low - high, 2 * high - low).astype(np.float32)
    distance = np.linalg.norm(lab - colour, axis=-1).astype(np.float32)
    return Ground(lab, colour, distance, border_of(distance))


def _terms(height: int, width: int) -> Float32[np.ndarray, "h w 6"]:
    """The six terms of a polynomial of second degree, for places from -1 to 1."""
    down, across = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    return np.stack([np.ones_like(down), across, down, across**2, down**2, across * down], axis=-1).astype(np.float32)
