"""What a plain ground tells of each pixel: that it is ground, that it is object, or neither, as of a shadow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32

from dipcg.images.ground import Ground, border_of

# A ground is plain where this share of the border is nearer to the fitted colour than this, in CIELAB.
PLAIN_SHARE, PLAIN_DISTANCE = 0.8, 5.0
# The least and largest difference from the ground that may be its noise, and that of the blocks of a JPEG beside edges.
LEAST_NOISE, MOST_NOISE, BLOCK_NOISE = 1.2, 6.0, 5.0
# Half of the width, for a picture of 256 a side, up to which pixels as near to the ground are such blocks.
BLOCK_REACH = 5
# What differs by this much, and by this many times as much as most of the border, is no ground, unless it is a shadow.
OBJECT_DISTANCE, OBJECT_TIMES = 8.0, 4.0
# A shadow is the ground with less light: its brightness as a share of the ground's, and how far its colour may be off.
SHADOW_DARKEST, SHADOW_COLOUR = 0.35, 5.0
# The probability above which nothing is ground, and that above which a pale piece with an edge is the object.
SURE_OBJECT, PALE_LIKELY = 0.7, 0.1
# Below this a narrow piece is no object.
NARROW_LIKELY = 0.3
# Something pale has an edge where its colour differs, a few pixels inside, by this many times the noise. A shadow is
# darker than this share of the ground's light, or has no edge on so much of its outline.
EDGE_TIMES, PALE, EDGED = 1.5, 0.85, 0.7


class Known(NamedTuple):
    """The pixels that are surely the object's, those that surely are not, and those of the ground's colour."""

    object: Bool[np.ndarray, "h w"]
    ground: Bool[np.ndarray, "h w"]
    alike: Bool[np.ndarray, "h w"]

    @property
    def is_all(self) -> bool:
        """Whether nothing is left to decide."""
        return bool((self.object | self.ground | self.alike).all())


def is_plain(ground: Ground) -> bool:
    """Whether the border has one colour, or one that changes slowly."""
    return bool((ground.border < PLAIN_DISTANCE).mean() > PLAIN_SHARE)


def known_from(ground: Ground, likely: Float32[np.ndarray, "h w"]) -> Known:
    """Tell the object from a plain ground; `likely` is the segmenter's probability of each pixel."""
    spread = float(np.percentile(ground.border, 100 * PLAIN_SHARE))
    noise = float(np.clip(2 * spread, LEAST_NOISE, MOST_NOISE))
    alike = (ground.distance < noise) & (likely < SURE_OBJECT)
    enough = max(OBJECT_DISTANCE, OBJECT_TIMES * spread)
    shadow = _like_shadow(ground)
    other = (ground.distance > enough) & ~shadow
    outside = connected_to_border(alike)
    # Narrow rims of shadows, and the blocks of a JPEG.
    rest = ((ground.distance < BLOCK_NOISE) | (shadow & (likely < NARROW_LIKELY))) & ~other
    outside |= _narrow(connected_to_border(outside | rest) & ~outside)
    undecided = ~outside & ~alike & ~other
    pale = _pale_pieces(ground, undecided & ~_narrow(undecided), outside | alike, EDGE_TIMES * noise)
    # No shadow is larger than its object, but white petals are larger than what they surround.
    if pale.sum() <= other.sum():
        pale &= _mean_of_pieces(likely, pale) > PALE_LIKELY
    return Known(other | pale, outside, alike)


def connected_to_border(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The pieces of a mask that reach the border."""
    import cv2

    _, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    touching = np.unique(border_of(labels)[border_of(mask)])
    return np.isin(labels, touching) & mask


def _like_shadow(ground: Ground) -> Bool[np.ndarray, "h w"]:
    """Where the colour is the ground's with less light; the colour of a shadow fades with its light."""
    share = ground.lab[..., 0] / np.maximum(ground.colour[..., 0], 1)
    apart = np.linalg.norm(ground.lab[..., 1:] - share[..., None] * ground.colour[..., 1:], axis=-1)
    return (share > SHADOW_DARKEST) & (share < 1.02) & (apart < SHADOW_COLOUR)


def _pale_pieces(
    ground: Ground, mask: Bool[np.ndarray, "h w"], outside: Bool[np.ndarray, "h w"], difference: float
) -> Bool[np.ndarray, "h w"]:
    """The pieces of a mask that are hardly darker than the ground, but have an edge on most of their outline."""
    import cv2

    outline = (np.asarray(cv2.dilate(outside.astype(np.uint8), np.ones((5, 5))), np.uint8) > 0) & mask
    inside = np.asarray(cv2.dilate(np.where(mask, ground.distance, 0), np.ones((7, 7))), np.float32)
    share = ground.lab[..., 0] / np.maximum(ground.colour[..., 0], 1)
    edged = _mean_of_pieces(inside > difference, mask, outline) > EDGED
    return mask & edged & (_mean_of_pieces(share, mask) > PALE)


def _mean_of_pieces(
    values: np.ndarray, mask: Bool[np.ndarray, "h w"], counted: Bool[np.ndarray, "h w"] | None = None
) -> Float32[np.ndarray, "h w"]:
    """At each pixel, the mean over the piece of the mask that it belongs to; only some pixels may be counted."""
    import cv2

    labels = np.asarray(cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)[1], np.int64)
    counted = mask if counted is None else counted
    sizes = np.bincount(labels[counted], minlength=labels.max() + 1)
    sums = np.bincount(labels[counted], values[counted].astype(np.float64), len(sizes))
    return (sums / np.maximum(sizes, 1))[labels].astype(np.float32)


def _narrow(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The mask without what is wide, as a white side of an object is."""
    import cv2

    reach = max(1, round(BLOCK_REACH * max(mask.shape) / 256))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    core = cv2.erode(mask.astype(np.uint8), disc, borderValue=(0,))
    return mask & (np.asarray(cv2.dilate(core, np.ones((2 * reach + 5,) * 2, np.uint8))) == 0)
