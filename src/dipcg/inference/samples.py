"""The pixels of a photograph that show each part of an estimate, which may lie a little beside the photograph."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Int, UInt8

from dipcg.images.ground import to_lab
from dipcg.materials import Colour

Picture = UInt8[np.ndarray, "s s 4"]
Where = Bool[np.ndarray, "s s"]

# A part is seen where this many pixels are its own and not at its edge.
LEAST_PIXELS = 12
# An estimate meets the object where it covers this share of what is drawn; lines do not.
MET = 0.3
# Half of the width in pixels from which a part covers its picture even where it is off.
WIDE = 8.0
# So many pixels beside a thin part its picture may lie.
REACH = 12.0
# A pixel looks like the ground when its a and b of CIELAB are as near, and its lightness is from this share of it on.
GROUND_CHROMA, GROUND_SHADE = 8.0, 0.55
KERNEL = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class Sample:
    """The pixels that show a part, half its width in pixels, and whether they may show the ground instead."""

    where: Where
    half: float
    doubtful: bool
    share: float
    """how many pixels show it, relative to how many should"""


Found = dict[int, Sample]


def samples(picture: Picture, drawn: Int[np.ndarray, "s s"], parts: int, ground: Colour | None = None) -> Found:
    """For each part that is seen the pixels of the object that show it; `drawn` has the part in each pixel, or -1.

    A cut-out may hold ground between legs, and its shadow, so that pixels that look like it count only where a part has
    no others. The picture of a thin part may lie beside it: of the pixels that no part covers it has the near ones.
    """
    solid, pale = picture[..., 3] > 250, _like_ground(picture, ground)
    inner, clear = _inner(drawn), np.asarray(cv2.erode(solid.astype(np.uint8), KERNEL), np.uint8) > 0
    if (clear & (inner >= 0)).sum() < MET * (inner >= 0).sum():
        return {}
    # What is as thin as an edge in the photograph is seen at its edges alone.
    return _found(solid, inner, drawn, pale, parts) | _found(clear, inner, drawn, pale, parts)


def _found(solid: Where, own: Int[np.ndarray, "s s"], drawn: Int[np.ndarray, "s s"], pale: Where, parts: int) -> Found:
    beside = _beside(drawn, solid & ~pale)
    every = [_sample(solid & (own == part), beside == part, pale, int((own == part).sum())) for part in range(parts)]
    return {part: sample for part, sample in enumerate(every) if sample is not None}


def _sample(own: Where, beside: Where, pale: Where, drawn: int) -> Sample | None:
    """The pixels of a part of its `own` and those `beside` it, without the `pale` ones if there are enough others."""
    if drawn < LEAST_PIXELS:
        return None
    half = _half_width(own)
    near = np.zeros_like(own) if half >= WIDE else beside
    clear = (own & ~pale) | near
    if clear.sum() >= max(LEAST_PIXELS, own.sum() / (2 if half >= WIDE else 4)):
        return Sample(clear, half, False, clear.sum() / drawn)
    # What the cut-out holds only in pieces is no part, but ground that was left in it.
    if own.sum() < max(LEAST_PIXELS, drawn / 2 if pale.any() else 0):
        return None
    return Sample(own, half, half < WIDE, own.sum() / drawn)


def _half_width(where: Where) -> float:
    """The largest distance of a pixel to the edge of the region."""
    return float(cv2.distanceTransform(where.astype(np.uint8), cv2.DIST_L2, 5).max())


def _like_ground(picture: Picture, ground: Colour | None) -> Where:
    """Where the picture has the colour of the ground, also in a soft shadow; nowhere when the ground is not known."""
    if ground is None:
        return np.zeros(picture.shape[:2], bool)
    lab = to_lab(picture)
    one = np.rint(255 * np.array([[[*ground, 1.0]]])).astype(np.uint8)
    lightness, *chroma = to_lab(one)[0, 0]
    same = np.linalg.norm(lab[..., 1:] - np.array(chroma), axis=-1) < GROUND_CHROMA
    return same & (lab[..., 0] > GROUND_SHADE * lightness) & (lab[..., 0] < lightness + GROUND_CHROMA)


def _inner(drawn: Int[np.ndarray, "s s"]) -> Int[np.ndarray, "s s"]:
    """The part of each pixel, -1 at the edges of parts too."""
    levels = (drawn + 1).astype(np.uint8)
    return np.where(cv2.erode(levels, KERNEL) == cv2.dilate(levels, KERNEL), drawn, -1)


def _beside(drawn: Int[np.ndarray, "s s"], wanted: Where) -> Int[np.ndarray, "s s"]:
    """For each wanted pixel that no part covers the nearest part within reach, else -1."""
    from scipy.ndimage import distance_transform_edt

    if (drawn < 0).all():
        return drawn
    far, nearest = distance_transform_edt(drawn < 0, return_indices=True)  # type: ignore[misc]
    return np.where(wanted & (far > 0) & (far <= REACH), drawn[tuple(nearest)], -1)
