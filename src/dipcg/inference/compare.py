"""The agreement of a render with a picture, by silhouettes and lines; both are cropped as `images.prepare` does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, UInt8

from dipcg.images import crop_to_object, edges
from dipcg.results import Seen

# Side of the pictures that are compared; the other lengths are shares of it.
SIDE = 128
# The distance beyond which two lines do not match.
REACH = 0.06
# The blur of silhouettes: without it a thin board that is a little off would overlap nowhere.
BLUR = 0.02


@dataclass(frozen=True)
class Match:
    """`silhouette`: intersection over union, softened. `lines`: 1 where they coincide, 0 where none is within `REACH`.

    Both are from 0 to 1; `silhouette` is None when that of the picture cannot be trusted.
    """

    silhouette: float | None
    lines: float

    @property
    def agreement(self) -> float:
        """From 0 to 1: the mean of both, or the lines alone where the silhouette cannot be trusted."""
        return self.lines if self.silhouette is None else (self.silhouette + self.lines) / 2


@dataclass(frozen=True)
class Outline:
    """The features of a picture that are compared: blurred coverage, lines, and the distance to the nearest line."""

    coverage: Float32[np.ndarray, "s s"]
    lines: Bool[np.ndarray, "s s"]
    distance: Float32[np.ndarray, "s s"]


def outline(image: UInt8[np.ndarray, "s s 4"]) -> Outline:
    """The features of a picture that is already cropped to the object."""
    import cv2

    drawn = edges(image)[..., 0]
    reach = REACH * len(image)
    distance = np.minimum(cv2.distanceTransform(drawn, cv2.DIST_L2, 3), reach) / reach
    coverage = cv2.GaussianBlur(image[..., 3].astype(np.float32) / 255, (0, 0), BLUR * len(image))
    return Outline(np.asarray(coverage), drawn == 0, distance.astype(np.float32))


class Picture:
    """A picture that many renders are compared with."""

    def __init__(self, image: UInt8[np.ndarray, "s s 4"], background: Seen) -> None:
        self.outline = outline(crop_to_object(image, SIDE))
        # The silhouette of a drawing means nothing, and GrabCut loses legs and leaves shadows.
        self.has_silhouette = background not in ("photo", "drawing")

    def match(self, render: UInt8[np.ndarray, "s s 4"]) -> Match:
        """Compare a render of the side `SIDE` with the picture."""
        theirs, ours = self.outline, outline(render)
        overlap = None
        if self.has_silhouette:
            both, either = np.minimum(theirs.coverage, ours.coverage), np.maximum(theirs.coverage, ours.coverage)
            overlap = float(both.sum() / max(float(either.sum()), 1.0))
        apart = (_mean(theirs.distance, ours.lines) + _mean(ours.distance, theirs.lines)) / 2
        return Match(overlap, 1 - apart)


def _mean(values: Float32[np.ndarray, "s s"], where: Bool[np.ndarray, "s s"]) -> float:
    return float(values[where].mean()) if where.any() else 1.0
