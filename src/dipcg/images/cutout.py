"""Cutting the object out of a picture: what is not the object becomes transparent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float32, UInt8
from PIL import Image

from dipcg.images.formats import ImageError
from dipcg.images.read import RGBA, Source, read_image
from dipcg.images.views import crop_to_object

Background = Literal["alpha", "plain", "photo"]

# Transparency that leaves a box of at least this share of each side, nearly filled, has trimmed a picture's edges or
# corners, and has cut nothing out.
TRIMMED_SIDE, TRIMMED_FILL = 0.9, 0.95
# Share of the border's pixels that have nearly one colour on a plain background.
PLAIN_SHARE = 0.8
# The largest difference from the background's colour, in CIELAB, that still counts as background.
PLAIN_DISTANCE = 14.0

# The darkest and most coloured that a soft shadow may be in CIELAB, its steepest slope per pixel of 512 a side, and the
# blur before the slope is measured.
SHADOW_DEPTH, SHADOW_COLOUR, SHADOW_SLOPE, SHADOW_BLUR = 35.0, 5.0, 1.2, 1.0


@dataclass(frozen=True)
class Cutout:
    """The object of a picture on a transparent ground, and which of three kinds of background it was cut from.

    alpha: the picture was transparent already. plain: its border has one colour. photo: anything else.
    """

    image: RGBA
    background: Background
    notes: tuple[str, ...] = ()
    """sentences about the picture that its user should know"""

    def crop(self, size: int) -> UInt8[np.ndarray, "size size 4"]:
        """The object as a network of this input size is given it."""
        return crop_to_object(self.image, size)


def cut_out(source: Source | Cutout) -> Cutout:
    """Read a picture and make everything but the object transparent; what is cut out already stays as it is.

    A photograph is cut by rembg where it is installed, and by GrabCut (Rother et al. 2004) where it is not. Raises
    ImageError for a picture that cannot be used, or when nothing is left of it.
    """
    if isinstance(source, Cutout):
        return source
    image, notes = read_image(source)
    if (image[..., 3] < 128).mean() > 0.005 and not _only_trims(image[..., 3]):
        return Cutout(_not_empty(image), "alpha", notes)
    image = _untrimmed(image)
    plain = _border_is_plain(image)
    alpha = _plain_alpha(image) if plain else _photo_alpha(image)
    return Cutout(_not_empty(np.dstack([image[..., :3], alpha])), "plain" if plain else "photo", notes)


def cut_by_colour(image: RGBA, difference: float) -> RGBA:
    """Make transparent what differs from the border's colour by less than `difference` in CIELAB.

    Raises ImageError when nothing is left.
    """
    apart = _from_background(image) >= difference
    return _not_empty(np.dstack([image[..., :3], np.where(apart, image[..., 3], 0).astype(np.uint8)]))


def prepare(source: Source | Cutout, size: int) -> tuple[UInt8[np.ndarray, "size size 4"], Background]:
    """From any picture to what an encoder is given: read, cut out, cropped to the object."""
    cutout = cut_out(source)
    return cutout.crop(size), cutout.background


def _only_trims(alpha: UInt8[np.ndarray, "h w"]) -> bool:
    """Whether the transparent pixels are those outside a window with rounded corners, or a thin frame."""
    ys, xs = np.nonzero(alpha >= 128)
    if not len(ys):
        return False
    height, width = np.ptp(ys) + 1, np.ptp(xs) + 1
    large = height >= TRIMMED_SIDE * alpha.shape[0] and width >= TRIMMED_SIDE * alpha.shape[1]
    return bool(large and len(ys) >= TRIMMED_FILL * height * width)


def _untrimmed(image: RGBA) -> RGBA:
    """The picture with its transparent corners or edges in the colour that is beside them."""
    opaque = image[..., 3] == 255
    if opaque.all():
        return image
    ys, xs = np.nonzero(opaque)
    border = _border(image[ys.min() : ys.max() + 1, xs.min() : xs.max() + 1])
    ground = np.median(border[border[:, 3] == 255], axis=0).astype(np.uint8)
    return np.where(opaque[..., None], image, ground)


def _not_empty(image: RGBA) -> RGBA:
    share = (image[..., 3] > 32).mean()
    if share < 0.002:
        raise ImageError("No object was found in the picture: it is all background. Use one that shows the object.")
    return image


def _lab(image: RGBA) -> Float32[np.ndarray, "h w 3"]:
    import cv2

    return cv2.cvtColor(image[..., :3].astype(np.float32) / 255, cv2.COLOR_RGB2LAB)


def _border(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values[0], values[-1], values[:, 0], values[:, -1]])


def _from_background(image: RGBA) -> Float32[np.ndarray, "h w"]:
    lab = _lab(image)
    return np.linalg.norm(lab - np.median(_border(lab), axis=0), axis=-1)


def _border_is_plain(image: RGBA) -> bool:
    return bool((_border(_from_background(image)) < PLAIN_DISTANCE).mean() > PLAIN_SHARE)


def _plain_alpha(image: RGBA) -> UInt8[np.ndarray, "h w"]:
    """Opaque where the colour differs from the border's; holes between slats open too, shadows mostly vanish."""
    distance = _from_background(image)
    sharp = PLAIN_DISTANCE / 2
    alpha = np.clip((distance - sharp / 2) / sharp, 0, 1)
    outside = _with_soft_shadow(image, _connected_to_border(distance < PLAIN_DISTANCE / 3))
    # A white seat on white stays where something encloses it.
    light_inside = ~outside & (distance >= 1.0)
    alpha = np.where(outside, 0, np.maximum(alpha, 0.999 * light_inside))
    return _without_specks((alpha * 255).astype(np.uint8))


def _with_soft_shadow(image: RGBA, outside: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Let the background grow into what is as colourless as it, not much darker, and without an edge.

    A white object may look the same; where most of it would be lost, the background stays as it was.
    """
    import cv2

    lab = cv2.GaussianBlur(_lab(image), (0, 0), SHADOW_BLUR * max(image.shape) / 512)
    ground = np.median(_border(lab), axis=0)
    slope = np.hypot(*(cv2.Sobel(lab[..., 0], -1, *axis) for axis in ((1, 0), (0, 1)))) / 8
    faint = (ground[0] - lab[..., 0] < SHADOW_DEPTH) & (np.abs(lab - ground)[..., 1:].max(-1) < SHADOW_COLOUR)
    grown = _connected_to_border(outside | (faint & (slope < SHADOW_SLOPE * 512 / max(image.shape))))
    return grown if (grown & ~outside).sum() < 0.6 * (~grown).sum() else outside


def _without_specks(alpha: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Drop what is too small to be part of the object, but keep thin lines: a median would erase a drawing."""
    import cv2

    labels = np.asarray(cv2.connectedComponents((alpha > 32).astype(np.uint8), connectivity=8)[1], np.int64)
    areas = np.bincount(labels.ravel())
    # The background is no component.
    areas[0] = 0
    small = areas < max(4, 0.002 * areas.sum())
    return np.where(small[labels], 0, alpha)


def _connected_to_border(background: np.ndarray) -> np.ndarray:
    import cv2

    _, labels = cv2.connectedComponents(background.astype(np.uint8), connectivity=4)
    touching = np.unique(_border(labels)[_border(background)])
    return np.isin(labels, touching) & background


def _photo_alpha(image: RGBA) -> UInt8[np.ndarray, "h w"]:
    try:
        from rembg import remove
    except ImportError:
        return _grabcut(image)
    return np.asarray(remove(Image.fromarray(image[..., :3]), only_mask=True))


def _grabcut(image: RGBA) -> UInt8[np.ndarray, "h w"]:
    import cv2

    height, width = image.shape[:2]
    scale = min(1.0, 384 / max(height, width))
    small = cv2.resize(np.ascontiguousarray(image[..., 2::-1]), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    mask = np.zeros(small.shape[:2], np.uint8)
    inset = [max(1, int(0.02 * side)) for side in (small.shape[1], small.shape[0])]
    box = (*inset, small.shape[1] - 2 * inset[0], small.shape[0] - 2 * inset[1])
    cv2.grabCut(small, mask, box, np.zeros((1, 65)), np.zeros((1, 65)), 5, cv2.GC_INIT_WITH_RECT)
    return cv2.resize(np.where(mask & 1, 255, 0).astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR)
