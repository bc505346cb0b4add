"""The pieces of a cut-out: specks are dropped, and of several things side by side one is taken."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64, UInt8

# A piece below this share of all that is opaque is a speck; thin lines are not, whose pieces are all small.
SPECK = 0.002
# A piece that is this large, compared with the largest, is a thing of its own where it stands beside it.
LARGE = 0.2
# Pieces nearer than this share of the side belong together.
GAP = 0.05
SEVERAL = "The picture shows {count} separate things; one of them was taken. Mark another, or crop the picture to it."


def without_specks(alpha: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Drop what is too small to be part of the object, but keep thin lines: a median would erase a drawing."""
    labels = _labels(alpha > 32)
    areas = _areas(labels)
    small = areas < max(4, SPECK * areas.sum())
    return np.where(small[labels], 0, alpha)


def one_thing(alpha: UInt8[np.ndarray, "h w"]) -> tuple[UInt8[np.ndarray, "h w"], tuple[str, ...]]:
    """The largest thing, and a sentence where there are several; the nearer to the middle, the larger one counts.

    Things stand side by side. What is above or below another piece is part of the same thing, as a table's top is where
    its white legs are lost.
    """
    import cv2

    opaque = alpha > 127
    reach = max(1, round(GAP * max(alpha.shape) / 2))
    joined = np.asarray(cv2.dilate(opaque.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)), np.uint8) > 0
    labels = _labels(joined)
    areas = np.bincount(labels[opaque], minlength=labels.max() + 1)
    groups = _groups(labels, [label for label in range(1, len(areas)) if areas[label]])
    sizes = [areas[group].sum() * _centrality(np.isin(labels, group)) for group in groups]
    if len(groups) < 2 or sorted(sizes)[-2] < LARGE * max(sizes):
        return alpha, ()
    best = groups[int(np.argmax(sizes))]
    count = sum(size >= LARGE * max(sizes) for size in sizes)
    return np.where(np.isin(labels, best), alpha, 0), (SEVERAL.format(count=count),)


def touched(alpha: UInt8[np.ndarray, "h w"], strokes: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """The pieces that a stroke touches."""
    labels = _labels(alpha > 127)
    chosen = np.unique(labels[strokes & (labels > 0)])
    return np.where(np.isin(labels, chosen), alpha, 0) if len(chosen) else alpha


def _labels(mask: Bool[np.ndarray, "h w"]) -> Int64[np.ndarray, "h w"]:
    import cv2

    return np.asarray(cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)[1], np.int64)


def _areas(labels: Int64[np.ndarray, "h w"]) -> Int64[np.ndarray, " n"]:
    """Pixels of each piece; the background, number 0, is no piece."""
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    return areas


def _groups(labels: Int64[np.ndarray, "h w"], names: list[int]) -> list[list[int]]:
    """Pieces whose extents from left to right overlap by half of the narrower one belong to one group."""
    spans = {name: np.nonzero((labels == name).any(0))[0][[0, -1]] for name in names}
    groups: list[list[int]] = []
    for name in sorted(names, key=lambda name: int(spans[name][0] - spans[name][1])):
        first, last = spans[name]
        for group in groups:
            left, right = min(spans[one][0] for one in group), max(spans[one][1] for one in group)
            if min(last, right) - max(first, left) > 0.5 * (last - first):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups


def _centrality(mask: Bool[np.ndarray, "h w"]) -> float:
    """1 for what is in the middle of the picture, 0.5 for what is in a corner."""
    ys, xs = np.nonzero(mask)
    away = np.hypot(ys.mean() / mask.shape[0] - 0.5, xs.mean() / mask.shape[1] - 0.5)
    return float(1 - away / np.sqrt(2))
