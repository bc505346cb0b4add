"""Reading a picture: upright, shrunk, as 8 bits, with the values that are there stretched where they are tiny.

A picture is decoded once, in the mode in which its file holds it, and converted strip by strip while it is shrunk, so
that the memory needed is little more than that of the decoded file.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from dipcg.images.depth import FULL_SCALES, deep_png, read_deep, stretched
from dipcg.images.formats import ImageError, check_size, open_picture

Source = str | Path | bytes | Image.Image | np.ndarray
RGBA = UInt8[np.ndarray, "h w 4"]

# Larger pictures are shrunk when they are read: no encoder sees more, and cutting out would take long.
MAX_SIDE = 1024
# Pixels of a strip.
STRIP = 1_000_000

_ORIENTATION = 0x0112
# EXIF 2.3, section 4.6.4: how to turn what a camera of this orientation has stored.
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}


class Picture(NamedTuple):
    """What was read, and sentences about it that its user should know."""

    image: RGBA
    notes: tuple[str, ...] = ()


def load_image(source: Source) -> RGBA:
    """Read a picture from a path, bytes, a PIL image or an array, upright and with no side over `MAX_SIDE`.

    Raises ImageError for anything that is not one usable picture.
    """
    return read_image(source).image


def read_image(source: Source) -> Picture:
    """The same, with notes: sentences that say what of the file was left out."""
    if isinstance(source, np.ndarray):
        return _converted(lambda: _from_array(source), "The picture")
    if isinstance(source, Image.Image):
        return _converted(lambda: source, "The picture")
    if isinstance(source, bytes):
        return _converted(lambda: open_picture(source, "The picture"), "The picture")
    path = Path(source)
    if not path.is_file():
        raise ImageError(f"There is no picture at {path}.")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ImageError(f"{path} cannot be read ({error.strerror}).") from None
    return _converted(lambda: open_picture(data, str(path)), str(path))


def _converted(opened: Callable[[], Image.Image], name: str) -> Picture:
    """The picture, where whatever Pillow raises for a damaged file becomes a sentence."""
    try:
        return _read(opened(), name)
    except ImageError:
        raise
    except Image.DecompressionBombError as error:
        raise ImageError(f"{name} is too large: {error}") from None
    except MemoryError:
        raise ImageError(f"{name} needs more memory than there is; save it with fewer pixels.") from None
    except (OSError, SyntaxError, ValueError, EOFError, RuntimeError, IndexError, struct.error) as error:
        raise ImageError(f"{name} is damaged or cut short ({error}).") from None


def _from_array(array: np.ndarray) -> Image.Image:
    if array.dtype != np.uint8 or array.shape[2:] not in ((), (3,), (4,)) or array.ndim < 2 or not array.size:
        got = f"{array.dtype} of shape {array.shape}"
        raise ImageError(f"The picture must be an array of uint8 of shape (h, w), (h, w, 3) or (h, w, 4), got {got}.")
    return Image.fromarray(array)


def _read(picture: Image.Image, name: str) -> Picture:
    check_size(picture, name)
    # A phone's JPEG has a second frame for screens of high contrast, which nobody misses.
    several = getattr(picture, "is_animated", False) and picture.format != "MPO"
    # A JPEG is unpacked at half, a quarter or an eighth of its size, but no smaller than this.
    picture.draft(None, (2 * MAX_SIDE, 2 * MAX_SIDE))
    deep = deep_png(picture)
    picture.load()
    # Pillow turns a TIFF upright when it is loaded, and takes the orientation away.
    turn = _TURNS.get(picture.getexif().get(_ORIENTATION, 1))
    if deep is not None:
        picture = read_deep(deep)
    image = _grey(picture) if picture.mode[0] in "IF" else _colour(picture)
    if not image[..., :3].any() and (image[..., 3] == 255).all():
        raise ImageError(f"{name} is black all over, so it shows nothing; look whether it was saved as it should be.")
    upright = image if turn is None else np.array(Image.fromarray(image).transpose(turn))
    return Picture(upright, (f"{name} has several frames or pages; the first is used.",) if several else ())


def _colour(picture: Image.Image) -> RGBA:
    """A picture of 8 bits, shrunk."""
    if max(picture.size) <= MAX_SIDE:
        shrunk = picture.convert("RGBA")
    else:
        # Colours that nothing is seen of do not bleed into others.
        shrunk = _shrunk(picture, "RGBa", lambda strip: strip.convert("RGBA").convert("RGBa")).convert("RGBA")
    image = np.array(shrunk)
    return np.dstack([stretched(image[..., :3], (255.0,)), image[..., 3]])


def _grey(picture: Image.Image) -> RGBA:
    """A picture of 16 or 32 bits, shrunk; what is no number becomes 0."""

    def values(strip: Image.Image) -> Image.Image:
        return Image.fromarray(np.nan_to_num(np.asarray(strip).astype(np.float32), posinf=0, neginf=0))

    grey = stretched(np.asarray(_shrunk(picture, "F", values)), FULL_SCALES)
    return np.dstack([grey, grey, grey, np.full_like(grey, 255)])


def _shrunk(picture: Image.Image, mode: str, convert: Callable[[Image.Image], Image.Image]) -> Image.Image:
    """The picture with no side over `MAX_SIDE`, converted to another mode a few rows at a time."""
    (width, height), factor = picture.size, max(1, max(picture.size) // (2 * MAX_SIDE))
    rows = factor * max(1, STRIP // (width * factor))
    shrunk = Image.new(mode, (-(-width // factor), -(-height // factor)))
    for top in range(0, height, rows):
        strip = convert(picture.crop((0, top, width, min(top + rows, height))))
        shrunk.paste(strip.reduce(factor), (0, top // factor))
    shrunk.thumbnail((MAX_SIDE, MAX_SIDE), Image.Resampling.BOX)
    return shrunk
