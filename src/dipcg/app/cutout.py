"""The cut-out that the model will see, and how a visitor corrects it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import UInt8

from dipcg.images import ImageError, Source, cut_by_colour, cut_out, load_image

How = Literal["automatic", "by colour", "own mask", "nothing"]
HOWS: tuple[str, ...] = get_args(How)
SIDE = 320  # of the picture that is shown
MOST_CROPPED = 0.95  # of a side


@dataclass(frozen=True)
class Correction:
    """How to cut: `difference` from the background's colour in CIELAB, or a `mask`, light where the object is.

    `crop` is what is cut away first at the left, right, top and bottom, as shares of the picture's sides.
    """

    how: How = "automatic"
    difference: float = 14.0
    mask: Source | None = None
    crop: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


def corrected(source: Source, correction: Correction) -> UInt8[np.ndarray, "H W 4"]:
    """The picture with what a visitor cut away made transparent; as it is when cutting is left to the model.

    Raises images.ImageError with a sentence.
    """
    image = load_image(source)
    if correction.how == "own mask":  # which lies on all of the picture
        return cropped(_masked(image, correction.mask), correction.crop)
    image = cropped(image, correction.crop)
    if correction.how == "by colour":
        return cut_by_colour(image, correction.difference)
    if correction.how == "nothing":
        return _marked_as_cut(image)
    return image


def cropped(image: UInt8[np.ndarray, "h w 4"], crop: tuple[float, float, float, float]) -> UInt8[np.ndarray, "H W 4"]:
    """The picture without shares of it at the left, right, top and bottom; raises images.ImageError with a sentence."""
    left, right, top, bottom = crop
    if min(crop) < 0 or left + right > MOST_CROPPED or top + bottom > MOST_CROPPED:
        taken = ", ".join(f"{100 * share:.0f} %" for share in crop)
        raise ImageError(
            f"The crop leaves too little: left and right, and top and bottom, may take {100 * MOST_CROPPED:.0f} % "
            f"together, got {taken} at the left, right, top and bottom."
        )
    height, width = image.shape[:2]
    down = slice(int(top * height), height - int(bottom * height))  # at least a pixel, as int rounds down
    return image[down, int(left * width) : width - int(right * width)]


def shown(image: UInt8[np.ndarray, "h w 4"]) -> tuple[UInt8[np.ndarray, "s s 4"], str]:
    """The cut-out as the model will see it, and in words how it was made; raises images.ImageError."""
    cutout = cut_out(image)
    how = {
        "alpha": "Cut out by its transparency.",
        "plain": "Cut out from a plain background.",
        "photo": "Cut out of a photograph; look whether all of it is there.",
    }[cutout.background]
    return cutout.crop(SIDE), how


def _masked(image: UInt8[np.ndarray, "h w 4"], mask: Source | None) -> UInt8[np.ndarray, "h w 4"]:
    import cv2

    if mask is None:
        raise ImageError("Add the mask first: a picture that is light where the object is, and dark elsewhere.")
    given = load_image(mask)
    light = (given[..., :3].mean(-1) * (given[..., 3] / 255)).astype(np.uint8)
    alpha = cv2.resize(light, image.shape[1::-1], interpolation=cv2.INTER_AREA)
    return np.dstack([image[..., :3], np.where(alpha > 127, alpha, 0).astype(np.uint8)])


def _marked_as_cut(image: UInt8[np.ndarray, "h w 4"]) -> UInt8[np.ndarray, "H W 4"]:
    """All of the picture kept: a wide transparent border says that it was cut out already."""
    return np.pad(image, ((len(image) // 4 + 1,) * 2, (image.shape[1] // 4 + 1,) * 2, (0, 0)))
