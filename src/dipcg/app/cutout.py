"""The cut-out that the model will see, and how a visitor corrects it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import UInt8

from dipcg.app.models import Corrections, Crop, Stroke
from dipcg.images import Cutout, ImageError, Source, cut_by_colour, cut_out

RGBA = UInt8[np.ndarray, "_ _ 4"]
Marks = UInt8[np.ndarray, "_ _"]

# The most that may be cut away of a side, at both ends together.
MOST_CROPPED = 0.95
SENTENCES = {
    "alpha": "Cut out by its transparency.",
    "plain": "Cut out from a plain background.",
    "photo": "Cut out of a photograph; look whether all of it is there.",
}
# The mask of a cut-out says what is hidden and what is the object, as GrabCut names them.
HIDDEN, OBJECT = 0, 1
# Where no stroke is.
UNMARKED = 255


def cut(image: RGBA | Cutout, wanted: Corrections, mask: RGBA | None = None) -> Cutout:
    """Cut the object out as a visitor wants it; `mask` is light where the object is.

    Raises images.ImageError with a sentence.
    """
    if isinstance(image, Cutout) and wanted == Corrections():
        return image
    pixels = image.image if isinstance(image, Cutout) else image
    if wanted.how == "auto" and (wanted.foreground or wanted.background):
        drawn = (wanted.foreground, wanted.background)
        foreground, background = (_in_pixels(strokes, pixels, wanted.crop) for strokes in drawn)
        return cut_out(cropped(pixels, wanted.crop), foreground, background)
    found = _cut_by(wanted, pixels, mask)
    strokes = [(wanted.background, HIDDEN), (wanted.foreground, OBJECT)]
    if not any(drawn for drawn, _ in strokes):
        return found
    # The colours under what was cut away are still needed.
    whole = cropped(pixels, wanted.crop)
    # Strokes lie on all of the picture, as a mask does.
    marks = _marks(pixels.shape[:2], strokes)[_left(pixels.shape[:2], wanted.crop)]
    return replace(found, image=_with_strokes(whole, found.image, marks))


def cropped(image: RGBA, crop: Crop) -> RGBA:
    """The picture without shares of it at its sides; raises images.ImageError with a sentence."""
    if crop.left + crop.right > MOST_CROPPED or crop.top + crop.bottom > MOST_CROPPED:
        raise ImageError(
            f"The crop leaves too little: left and right, and top and bottom, may take {100 * MOST_CROPPED:.0f} % "
            f"together, got {100 * (crop.left + crop.right):.0f} % and {100 * (crop.top + crop.bottom):.0f} %."
        )
    return image[_left(image.shape[:2], crop)]


def _left(shape: tuple[int, ...], crop: Crop) -> tuple[slice, slice]:
    """The rows and columns that a crop leaves: at least one of each, since int() rounds down."""
    height, width = shape
    down = slice(int(crop.top * height), height - int(crop.bottom * height))
    return down, slice(int(crop.left * width), width - int(crop.right * width))


def _in_pixels(strokes: Sequence[Stroke], image: RGBA, crop: Crop) -> list[list[list[float]]]:
    """The points of strokes, which lie on all of the picture, in pixels of what a crop leaves of it."""
    down, across = _left(image.shape[:2], crop)
    height, width = image.shape[:2]
    start = [across.start, down.start]
    return [(np.array(stroke.points) * [width - 1, height - 1] - start).tolist() for stroke in strokes]


def _cut_by(wanted: Corrections, image: RGBA, mask: RGBA | None) -> Cutout:
    ways: dict[str, Callable[[], Source]] = {
        "auto": lambda: cropped(image, wanted.crop),
        "by colour": lambda: cut_by_colour(cropped(image, wanted.crop), wanted.difference),
        "as it is": lambda: _marked_as_cut(cropped(image, wanted.crop)),
        # The mask lies on all of the picture.
        "mask": lambda: cropped(_masked(image, mask), wanted.crop),
    }
    return cut_out(ways[wanted.how]())


def _masked(image: RGBA, mask: RGBA | None) -> RGBA:
    import cv2

    if mask is None:
        raise ImageError("Add the mask first: a picture that is light where the object is, and dark elsewhere.")
    light = (mask[..., :3].mean(-1) * (mask[..., 3] / 255)).astype(np.uint8)
    alpha = cv2.resize(light, image.shape[1::-1], interpolation=cv2.INTER_AREA)
    return np.dstack([image[..., :3], np.where(alpha > 127, alpha, 0).astype(np.uint8)])


def _marked_as_cut(image: RGBA) -> RGBA:
    """All of the picture kept: a wide transparent border says that it was cut out already."""
    return np.pad(image, ((len(image) // 4 + 1,) * 2, (image.shape[1] // 4 + 1,) * 2, (0, 0)))


def _with_strokes(whole: RGBA, found: RGBA, marks: Marks) -> RGBA:
    """The cut-out grown and shrunk to what the strokes say (GrabCut, Rother et al. 2004)."""
    import cv2

    height, width = whole.shape[:2]
    alpha = np.asarray(cv2.resize(found[..., 3], (width, height)), np.uint8)
    guess = np.where(alpha > 127, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    mask = np.where(marks == UNMARKED, guess, marks).astype(np.uint8)
    if (mask % 2 == 0).any() and (mask % 2 == 1).any():
        colours, models = np.ascontiguousarray(whole[..., 2::-1]), (np.zeros((1, 65)), np.zeros((1, 65)))
        cv2.grabCut(colours, mask, (0, 0, 1, 1), *models, 3, cv2.GC_INIT_WITH_MASK)
    kept = np.where(mask % 2 == 1, np.where(alpha > 127, alpha, 255), 0).astype(np.uint8)
    if not (kept > 32).any():
        raise ImageError("The strokes leave nothing of the object; take one of them back.")
    return np.dstack([whole[..., :3], kept])


def _marks(shape: tuple[int, ...], strokes: Sequence[tuple[Sequence[Stroke], int]]) -> Marks:
    marks = np.full(shape, UNMARKED, np.uint8)
    for drawn, value in strokes:
        for stroke in drawn:
            _draw(marks, stroke, value)
    return marks


def _draw(marks: Marks, stroke: Stroke, value: int) -> None:
    import cv2

    height, width = marks.shape
    points = np.rint(np.array(stroke.points) * [width - 1, height - 1]).astype(np.int32)
    thickness = max(1, round(2 * stroke.radius * max(height, width)))
    cv2.polylines(marks, [points.reshape(-1, 1, 2)], False, (value,), thickness)
