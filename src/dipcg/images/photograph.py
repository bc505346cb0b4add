"""Finding an object's edges: the segmenter says roughly where it is, and GrabCut follows the colours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, UInt8
from PIL import Image

from dipcg.images.plain import Known, connected_to_border
from dipcg.images.read import RGBA

# GrabCut's time grows with the pixels.
SIDE, ROUNDS = 256, 3
# What the segmenter is this sure of, GrabCut does not change.
SURE_GROUND, SURE_OBJECT = 0.03, 0.97
# The result is doubted where its overlap with the segmenter's is less.
DOUBTED = 0.4


class Marks(NamedTuple):
    """The pixels that are known to be the object's, and those known not to be."""

    object: Bool[np.ndarray, "h w"]
    ground: Bool[np.ndarray, "h w"]


def photo_alpha(image: RGBA, likely: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """The object of a photograph: by rembg where it is installed, and by GrabCut where it is not."""
    try:
        from rembg import remove
    except ImportError:
        found = grabcut(image, likely)
        return np.where(_holes(found, likely > 0.5), 255, found).astype(np.uint8)
    return np.asarray(remove(Image.fromarray(image[..., :3]), only_mask=True))


def plain_alpha(image: RGBA, likely: Float32[np.ndarray, "h w"], known: Known) -> UInt8[np.ndarray, "h w"]:
    """The object on a plain ground, where GrabCut decides on shadows and on what is as pale as the ground."""
    if known.is_all:
        return np.where(known.object, 255, 0).astype(np.uint8)
    found = grabcut(image, likely, Marks(known.object, known.ground)) > 127
    found = (found | known.object) & ~known.ground
    # What the object encloses belongs to it, unless the ground shows through.
    found |= _holes(found * np.uint8(255), np.ones_like(found))
    return np.where(found & ~known.alike, 255, 0).astype(np.uint8)


def grabcut(image: RGBA, likely: Float32[np.ndarray, "h w"], marks: Marks | None = None) -> UInt8[np.ndarray, "h w"]:
    """GrabCut (Rother et al. 2004), begun from the probability of each pixel instead of a frame."""
    import cv2

    height, width = image.shape[:2]
    scale = min(1.0, SIDE / max(height, width))
    small = cv2.resize(np.ascontiguousarray(image[..., 2::-1]), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    size = small.shape[1::-1]
    seeds = _seeds(cv2.resize(likely, size, interpolation=cv2.INTER_AREA))
    for marked, label in zip(marks or (), (cv2.GC_FGD, cv2.GC_BGD), strict=False):
        share = np.asarray(cv2.resize(marked.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32)
        seeds[share > 0.5] = label
    found = start = seeds & 1
    if start.any() and not start.all():
        cv2.grabCut(small, seeds, (0, 0, 1, 1), np.zeros((1, 65)), np.zeros((1, 65)), ROUNDS, cv2.GC_INIT_WITH_MASK)
        found = seeds & 1
    if marks is None and (found & start).sum() < DOUBTED * (found | start).sum():
        found = start
    return cv2.resize(found * np.uint8(255), (width, height), interpolation=cv2.INTER_LINEAR)


def _seeds(likely: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """GrabCut's labels: 0 and 1 are sure, 2 and 3 likely; the odd ones are the object."""
    threshold = min(0.5, 0.6 * float(likely.max()))
    return np.select([likely < SURE_GROUND, likely > SURE_OBJECT, likely > threshold], [0, 1, 3], 2).astype(np.uint8)


def _holes(alpha: UInt8[np.ndarray, "h w"], allowed: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Where the object encloses something, and this is allowed to be filled."""
    empty = alpha <= 127
    return empty & ~connected_to_border(empty) & allowed
