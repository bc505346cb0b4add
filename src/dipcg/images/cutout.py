"""Cutting the object out of a picture: what is not the object becomes transparent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, UInt8

from dipcg.images.formats import ImageError
from dipcg.images.ground import border_of, find_ground
from dipcg.images.photograph import Marks, grabcut, photo_alpha, plain_alpha
from dipcg.images.pieces import one_thing, touched, without_specks
from dipcg.images.plain import is_plain, known_from
from dipcg.images.read import RGBA, Source, read_image
from dipcg.images.views import crop_to_object, is_line_drawing, side_of_object
from dipcg.materials import Colour

Background = Literal["alpha", "plain", "photo"]
# A line through points of a picture, each as pixels across and down.
Stroke = Sequence[Sequence[float | int]]

# Transparency that leaves a box of at least this share of each side, nearly filled, has trimmed a picture's edges or
# corners, and has cut nothing out.
TRIMMED_SIDE, TRIMMED_FILL = 0.9, 0.95
# The largest side of the picture that an estimate keeps. Lines are told from surfaces at this size: in smaller pictures
# lines that lie close together become one surface.
PICTURE_SIDE = 256
# The width of a stroke as a share of the picture's longer side.
STROKE = 0.015


@dataclass(frozen=True)
class Cutout:
    """The object of a picture on a transparent ground, and which of three kinds of background it was cut from.

    alpha: the picture was transparent already. plain: its border has one colour. photo: anything else.
    """

    image: RGBA
    background: Background
    notes: tuple[str, ...] = ()
    """sentences about the picture that its user should know"""

    @property
    def ground(self) -> Colour | None:
        """The median colour of a plain ground that was cut away, in sRGB from 0 to 1; None for other grounds."""
        away = self.image[self.image[..., 3] < 16][:, :3]
        if self.background != "plain" or not len(away):
            return None
        red, green, blue = (float(value) / 255 for value in np.median(away, axis=0))
        return red, green, blue

    @property
    def is_drawing(self) -> bool:
        """Whether the object is drawn in lines, which say nothing about what it covers, or about its colours."""
        return is_line_drawing(crop_to_object(self.picture, PICTURE_SIDE))

    @cached_property
    def picture(self) -> UInt8[np.ndarray, "s s 4"]:
        """The object as an estimate keeps it, for comparing, colours and people: reduced, but never enlarged."""
        return self.crop(min(PICTURE_SIDE, side_of_object(self.image)))

    def crop(self, size: int) -> UInt8[np.ndarray, "size size 4"]:
        """The object as a network of this input size is given it."""
        return crop_to_object(self.image, size)


def cut_out(source: Source | Cutout, foreground: Sequence[Stroke] = (), background: Sequence[Stroke] = ()) -> Cutout:
    """Read a picture and make everything but the object transparent; what is cut out already stays as it is.

    Strokes over the object (`foreground`) and over what is not the object are in pixels of the picture as `load_image`
    returns it, and decide over whatever else is found. Raises ImageError for a picture that cannot be used, or when
    nothing is left of it.
    """
    if isinstance(source, Cutout):
        return source
    image, notes = read_image(source)
    if foreground or background:
        return _cut_by_strokes(image, foreground, background, notes)
    if (image[..., 3] < 128).mean() > 0.005 and not _only_trims(image[..., 3]):
        return Cutout(_not_empty(image), "alpha", notes)
    image = _untrimmed(image)
    alpha, kind = _alpha(image)
    alpha, said = one_thing(without_specks(alpha))
    return Cutout(_not_empty(np.dstack([image[..., :3], alpha])), kind, notes + said)


def cut_by_colour(image: RGBA, difference: float) -> RGBA:
    """Make transparent what differs from the border's colour by less than `difference` in CIELAB.

    Raises ImageError when nothing is left.
    """
    apart = find_ground(image).distance >= difference
    return _not_empty(np.dstack([image[..., :3], np.where(apart, image[..., 3], 0).astype(np.uint8)]))


def prepare(source: Source | Cutout, size: int) -> tuple[UInt8[np.ndarray, "size size 4"], Background]:
    """From any picture to what an encoder is given: read, cut out, cropped to the object."""
    cutout = cut_out(source)
    return cutout.crop(size), cutout.background


def _alpha(image: RGBA) -> tuple[UInt8[np.ndarray, "h w"], Background]:
    """What is the object of an opaque picture, and the kind of its ground."""
    from dipcg.images.segmenter import probability

    likely, ground = probability(image[..., :3]), find_ground(image)
    if is_plain(ground):
        return plain_alpha(image, likely, known_from(ground, likely)), "plain"
    return photo_alpha(image, likely), "photo"


def _cut_by_strokes(
    image: RGBA, foreground: Sequence[Stroke], background: Sequence[Stroke], notes: tuple[str, ...]
) -> Cutout:
    """What belongs to the strokes over the object, where the first guess is what would be found without them."""
    guess = (_alpha(_untrimmed(image))[0] / 255).astype(np.float32)
    marks = Marks(_drawn(foreground, image.shape[:2]), _drawn(background, image.shape[:2]))
    # Nothing is sure but the strokes.
    alpha = grabcut(image, 0.1 + 0.8 * guess, marks)
    alpha = touched(without_specks(np.where(marks.ground, 0, alpha).astype(np.uint8)), marks.object)
    return Cutout(_not_empty(np.dstack([image[..., :3], np.minimum(alpha, image[..., 3])])), "photo", notes)


def _drawn(strokes: Sequence[Stroke], size: tuple[int, ...]) -> Bool[np.ndarray, "h w"]:
    """The pixels under the strokes."""
    import cv2

    canvas, width = np.zeros(size, np.uint8), max(1, round(STROKE * max(size)))
    for stroke in strokes:
        points = np.rint(np.asarray(stroke, float).reshape(-1, 2)).astype(np.int32)
        cv2.polylines(canvas, [points[:, None]], False, (255,), width)
        # A line of one point would not be seen.
        cv2.circle(canvas, points[0].tolist(), (width + 1) // 2, (255,), -1)
    return canvas > 0


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
    if opaque.all() or not opaque.any():
        return image
    ys, xs = np.nonzero(opaque)
    border = border_of(image[ys.min() : ys.max() + 1, xs.min() : xs.max() + 1])
    ground = np.median(border[border[:, 3] == 255], axis=0).astype(np.uint8)
    return np.where(opaque[..., None], image, ground)


def _not_empty(image: RGBA) -> RGBA:
    share = (image[..., 3] > 32).mean()
    if share < 0.002:
        raise ImageError("No object was found in the picture: it is all background. Use one that shows the object.")
    return image
