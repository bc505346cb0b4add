"""Values of more or fewer than 8 bits: a sensor of 12 bits, a depth map in metres, a mask of 0 and 1."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from PIL import Image

# What the brightest value may be: of 1, 8, 10, 12, 14 or 16 bits.
FULL_SCALES = (1.0, 255.0, 1023.0, 4095.0, 16383.0, 65535.0)
# Where the brightest value is below this share of the full scale, it becomes the full scale.
DARK = 1 / 16
# Of pictures with 16 bits for each colour and more pixels, the upper 8 bits are read.
MAX_DEEP_PIXELS = 8_000_000


def stretched(values: np.ndarray, scales: Sequence[float]) -> UInt8[np.ndarray, "h w ..."]:
    """Values of any range as 8 bits; `scales` are what the brightest may be."""
    lowest = min(0.0, float(values.min()))
    full = _full_scale(float(values.max()) - lowest, scales)
    if values.dtype == np.uint8 and full == 255:
        return values
    return np.rint((values.astype(np.float32) - lowest) * (255 / full)).astype(np.uint8)


def deep_png(picture: Image.Image) -> bytes | None:
    """The file, where it has colours of 16 bits, of which Pillow keeps the upper 8 alone."""
    tiles, file = getattr(picture, "tile", ()), getattr(picture, "fp", None)
    few = picture.width * picture.height <= MAX_DEEP_PIXELS
    if not few or not file or picture.format != "PNG" or picture.mode[0] in "IF" or ";16" not in str(tiles):
        return None
    file.seek(0)
    return file.read()


def read_deep(data: bytes) -> Image.Image:
    """The picture with its values stretched before they are cut to 8 bits."""
    import cv2

    values = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED), np.uint16)
    colour = stretched(values[..., 2::-1], FULL_SCALES)
    return Image.fromarray(np.dstack([colour, (values[..., 3:] >> 8).astype(np.uint8)]))


def _full_scale(brightest: float, scales: Sequence[float]) -> float:
    """The smallest of the scales that holds all values; the brightest value where that would be dark on the scale."""
    full = next((scale for scale in scales if scale >= brightest), brightest)
    return brightest if 0 < brightest < DARK * full else full
