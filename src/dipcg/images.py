"""The only preparation of pictures in the project: read one, cut the object out, crop it as training pictures are.

An image is `UInt8[np.ndarray, "h w 4"]` with straight alpha.
"""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float32, UInt8
from PIL import Image, ImageOps, UnidentifiedImageError

from dipcg.files import written

Source = str | Path | bytes | Image.Image | np.ndarray
RGBA = UInt8[np.ndarray, "h w 4"]
Background = Literal["alpha", "plain", "photo"]

MAX_PIXELS = 64_000_000
MIN_SIDE = 16
# Larger pictures are shrunk when they are read: no encoder sees more, and cutting out would take long.
MAX_SIDE = 1024
# Share of the side that is free on either side of the object, as in training.
MARGIN = 0.06
# Share of the border's pixels that have nearly one colour on a plain background.
PLAIN_SHARE = 0.8
# The largest difference from the background's colour, in CIELAB, that still counts as background.
PLAIN_DISTANCE = 14.0

# The darkest and most coloured that a soft shadow may be in CIELAB, its steepest slope per pixel of 512 a side, and the
# blur before the slope is measured.
SHADOW_DEPTH, SHADOW_COLOUR, SHADOW_SLOPE, SHADOW_BLUR = 35.0, 5.0, 1.2, 1.0


class ImageError(ValueError):
    """A picture that cannot be used; the message says why and what to do."""


@dataclass(frozen=True)
class Cutout:
    """The object of a picture on a transparent ground, and which of three kinds of background it was cut from.

    alpha: the picture was transparent already. plain: its border has one colour. photo: anything else.
    """

    image: RGBA
    background: Background

    def crop(self, size: int) -> UInt8[np.ndarray, "size size 4"]:
        """The object as a network of this input size is given it."""
        return crop_to_object(self.image, size)


def load_image(source: Source) -> RGBA:
    """Read a picture from a path, bytes, a PIL image or an array, upright and with no side over `MAX_SIDE`.

    Raises ImageError for anything that is not one usable picture.
    """
    if not isinstance(source, (str, Path)):
        return _decode(source, "The picture")
    path = Path(source)
    if not path.is_file():
        raise ImageError(f"There is no picture at {path}.")
    try:
        return _decode(path.read_bytes(), str(path))
    except OSError as error:
        raise ImageError(f"{path} cannot be read ({error.strerror}).") from None


def cut_out(source: Source | Cutout) -> Cutout:
    """Read a picture and make everything but the object transparent; what is cut out already stays as it is.

    A photograph is cut by rembg where it is installed, and by GrabCut (Rother et al. 2004) where it is not. Raises
    ImageError for a picture that cannot be used, or when nothing is left of it.
    """
    if isinstance(source, Cutout):
        return source
    image = load_image(source)
    if (image[..., 3] < 128).mean() > 0.005:
        return Cutout(_not_empty(image), "alpha")
    plain = _border_is_plain(image)
    alpha = _plain_alpha(image) if plain else _photo_alpha(image)
    return Cutout(_not_empty(np.dstack([image[..., :3], alpha])), "plain" if plain else "photo")


def cut_by_colour(image: RGBA, difference: float) -> RGBA:
    """Make transparent what differs from the border's colour by less than `difference` in CIELAB.

    Raises ImageError when nothing is left.
    """
    apart = _from_background(image) >= difference
    return _not_empty(np.dstack([image[..., :3], np.where(apart, image[..., 3], 0).astype(np.uint8)]))


def crop_to_object(image: RGBA, size: int, margin: float = MARGIN) -> UInt8[np.ndarray, "size size 4"]:
    """A square picture of the object, centred, with `margin` of the side left free around its longer direction."""
    ys, xs = np.nonzero(image[..., 3] > 32)
    low, high = np.array([xs.min(), ys.min()]), np.array([xs.max() + 1, ys.max() + 1])
    half = (high - low).max() / 2 / (1 - 2 * margin)
    left, top = (low + high) / 2 - half
    box = (left, top, left + 2 * half, top + 2 * half)
    return _resize_premultiplied(image, box, size)


def over_white(image: RGBA) -> UInt8[np.ndarray, "h w 3"]:
    """The picture on a white ground."""
    import cv2

    alpha = cv2.merge([image[..., 3]] * 3)
    return cv2.add(cv2.multiply(image[..., :3], alpha, scale=1 / 255), cv2.bitwise_not(alpha))


def prepare(source: Source | Cutout, size: int) -> tuple[UInt8[np.ndarray, "size size 4"], Background]:
    """From any picture to what an encoder is given: read, cut out, cropped to the object."""
    cutout = cut_out(source)
    return cutout.crop(size), cutout.background


def edges(image: RGBA) -> UInt8[np.ndarray, "h w 4"]:
    """Dark Canny edges (Canny 1986) on white, opaque: the paper's sketch condition."""
    import cv2

    grey = cv2.cvtColor(over_white(image), cv2.COLOR_RGB2GRAY)
    drawn = np.maximum(np.asarray(cv2.Canny(grey, 60, 140), np.uint8), cv2.Canny(image[..., 3], 100, 200))
    return np.dstack([255 - drawn] * 3 + [np.full_like(drawn, 255)])


def silhouette(image: RGBA) -> UInt8[np.ndarray, "h w 4"]:
    """The object in plain dark grey: the paper's mask condition."""
    return np.dstack([np.full((*image.shape[:2], 3), 60, np.uint8), image[..., 3]])


def save_image(image: UInt8[np.ndarray, "h w c"], path: str | Path) -> None:
    """Write a PNG; raises OSError."""
    with written(path) as unfinished:
        Image.fromarray(np.ascontiguousarray(image)).save(unfinished)


def _decode(source: bytes | Image.Image | np.ndarray, name: str) -> RGBA:
    try:
        return _to_rgba(_open(source, name), name)
    except UnidentifiedImageError:
        raise ImageError(f"{name} is not a picture in a known format; use PNG, JPEG or WebP.") from None
    except Image.DecompressionBombError as error:
        raise ImageError(f"{name} is too large: {error}") from None
    except (OSError, SyntaxError, ValueError) as error:
        if isinstance(error, ImageError):
            raise
        raise ImageError(f"{name} is damaged or cut short ({error}).") from None


def _open(source: bytes | Image.Image | np.ndarray, name: str) -> Image.Image:
    if isinstance(source, Image.Image):
        return source
    if isinstance(source, bytes):
        if not source:
            raise ImageError(f"{name} is empty (0 bytes).")
        with warnings.catch_warnings():
            # The limit of this file is lower and has a message of its own.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            return Image.open(io.BytesIO(source))
    if source.dtype != np.uint8 or source.shape[2:] not in ((), (3,), (4,)) or source.ndim < 2 or not source.size:
        got = f"{source.dtype} of shape {source.shape}"
        raise ImageError(f"{name} must be an array of uint8 of shape (h, w), (h, w, 3) or (h, w, 4), got {got}.")
    return Image.fromarray(source)


def _to_rgba(picture: Image.Image, name: str) -> RGBA:
    width, height = picture.size
    if width * height > MAX_PIXELS:
        raise ImageError(f"{name} has {width} × {height} pixels; at most {MAX_PIXELS / 1e6:.0f} million are read.")
    if min(width, height) < MIN_SIDE:
        raise ImageError(f"{name} has {width} × {height} pixels; at least {MIN_SIDE} × {MIN_SIDE} are needed.")
    if picture.mode.startswith("I"):
        # Of 16 bits PIL would clip the values instead of scaling them.
        picture = Image.fromarray((np.asarray(picture, np.int64) >> 8).clip(0, 255).astype(np.uint8))
    upright = (ImageOps.exif_transpose(picture) or picture).convert("RGBA")
    # PIL weighs the colours by alpha here.
    upright.thumbnail((MAX_SIDE, MAX_SIDE), Image.Resampling.BOX)
    return np.array(upright)


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
