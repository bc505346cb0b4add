"""What is made of a picture with straight alpha: its crop to the object, and the conditions of the paper."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from dipcg.files import written
from dipcg.images.read import RGBA

# Share of the side that is free on either side of the object, as in training.
MARGIN = 0.06
# A picture whose object is nowhere thicker than this share of the side is a line drawing.
THICKNESS = 0.03
# The mean of red, green and blue from which a pixel counts as white paper.
PAPER = 250


def crop_to_object(image: RGBA, size: int, margin: float = MARGIN) -> UInt8[np.ndarray, "size size 4"]:
    """A square picture of the object, centred, with `margin` of the side left free around its longer direction."""
    return _resize_premultiplied(image, _square(image, margin), size)


def side_of_object(image: RGBA, margin: float = MARGIN) -> int:
    """The side of its crop at which no pixel is lost or made up."""
    left, _, right, _ = _square(image, margin)
    return math.ceil(right - left)


def over_white(image: RGBA) -> UInt8[np.ndarray, "h w 3"]:
    """The picture on a white ground."""
    import cv2

    alpha = cv2.merge([image[..., 3]] * 3)
    return cv2.add(cv2.multiply(image[..., :3], alpha, scale=1 / 255), cv2.bitwise_not(alpha))


def edges(image: RGBA) -> UInt8[np.ndarray, "h w 4"]:
    """Dark Canny edges (Canny 1986) on white, opaque: the paper's sketch condition."""
    import cv2

    grey = cv2.cvtColor(over_white(image), cv2.COLOR_RGB2GRAY)
    drawn = np.maximum(np.asarray(cv2.Canny(grey, 60, 140), np.uint8), cv2.Canny(image[..., 3], 100, 200))
    return np.dstack([255 - drawn] * 3 + [np.full_like(drawn, 255)])


def is_line_drawing(image: UInt8[np.ndarray, "s s 4"]) -> bool:
    """Whether nothing in a picture that is cropped to the object is thicker than a line but white paper between lines.

    A white object without any ink is not a drawing.
    """
    import cv2

    ink = (image[..., 3] > 127) & (image[..., :3].mean(-1) < PAPER)
    inside = cv2.distanceTransform(ink.astype(np.uint8), cv2.DIST_L2, 3)
    return 0 < float(inside.max()) < THICKNESS / 2 * len(image)


def silhouette(image: RGBA) -> UInt8[np.ndarray, "h w 4"]:
    """The object in plain dark grey: the paper's mask condition."""
    return np.dstack([np.full((*image.shape[:2], 3), 60, np.uint8), image[..., 3]])


def save_image(image: UInt8[np.ndarray, "h w c"], path: str | Path) -> None:
    """Write a PNG; raises OSError."""
    with written(path) as unfinished:
        Image.fromarray(np.ascontiguousarray(image)).save(unfinished)


def _square(image: RGBA, margin: float) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of the square around the object."""
    ys, xs = np.nonzero(image[..., 3] > 32)
    low, high = np.array([xs.min(), ys.min()]), np.array([xs.max() + 1, ys.max() + 1])
    half = (high - low).max() / 2 / (1 - 2 * margin)
    left, top = (low + high) / 2 - half
    return left, top, left + 2 * half, top + 2 * half


def _resize_premultiplied(
    image: RGBA, box: tuple[float, float, float, float], size: int
) -> UInt8[np.ndarray, "size size 4"]:
    """Crop (beyond the borders too) and resize without letting hidden colours bleed in."""
    alpha = image[..., 3:].astype(np.float32) / 255
    bands = [*np.moveaxis(image[..., :3] * alpha, -1, 0), image[..., 3].astype(np.float32)]
    pad = int(np.ceil(max(0, -box[0], -box[1], box[2] - image.shape[1], box[3] - image.shape[0])))
    left, top, right, bottom = (edge + pad for edge in box)
    shrinks = box[2] - box[0] > size
    kernel = Image.Resampling.BOX if shrinks else Image.Resampling.BILINEAR
    padded = [Image.fromarray(np.pad(band, pad)) for band in bands]
    resized = [np.asarray(band.resize((size, size), kernel, (left, top, right, bottom))) for band in padded]
    colour = np.dstack(resized[:3]) / np.maximum(resized[3][..., None] / 255, 1e-3)
    return np.rint(np.dstack([colour, resized[3]]).clip(0, 255)).astype(np.uint8)
