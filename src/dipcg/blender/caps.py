"""Flat ends of a solid, made again from the rings that they should meet.

Infinigen fills a table's top from a curve that it samples again, so the corners of the fill lie between those of the
rim: the surface looks closed, and has a slit all around.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from dipcg.mesh import Solid

# Vertices within this distance in metres are one.
SAME = 1e-6
# A face within this distance in metres of the lowest or highest place belongs to an end.
FLAT = 1e-5


def recapped(piece: Solid) -> Solid:
    """The piece, closed: its lowest and highest level faces are made again over the rings around them."""
    part, vertices, faces, quads, _ = _welded(piece)
    height = vertices[faces, 2]
    level = (height < height.min() + FLAT).all(1) | (height > height.max() - FLAT).all(1)
    rim = faces[~level]
    caps = [_filled(vertices, ring) for ring in _rings(rim)]
    every = np.concatenate([rim, *caps]).astype(faces.dtype)
    flat = np.full(len(every) - len(rim), -1, np.int32)
    return Solid(part, vertices, every, None if quads is None else np.concatenate([quads[~level], flat]))


def _welded(piece: Solid) -> Solid:
    part, vertices, faces, quads, _ = piece
    places = np.rint(vertices / SAME).astype(np.int64)
    _, first, merged = np.unique(places, axis=0, return_index=True, return_inverse=True)
    faces = merged.reshape(-1)[faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(1)
    return Solid(part, vertices[first], faces[whole], None if quads is None else quads[whole])


def _rings(faces: Int[np.ndarray, "f 3"]) -> Iterator[list[int]]:
    """The open edges as rings, each in the direction in which faces that close it go around."""
    a, b = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    many = faces.max() + 1
    open_ones = ~np.isin(a * many + b, b * many + a)
    after = dict(zip(b[open_ones].tolist(), a[open_ones].tolist(), strict=True))
    while after:
        ring = [next(iter(after))]
        while (corner := after.pop(ring[-1])) != ring[0]:
            ring.append(corner)
        yield ring


def _filled(vertices: Float[np.ndarray, "v 3"], ring: list[int]) -> Int[np.ndarray, "f 3"]:
    """Triangles over a level ring, seen from above or from below as the ring goes around."""
    import manifold3d

    flat = vertices[ring, :2].astype(float)
    (x, y), (later_x, later_y) = flat.T, np.roll(flat, -1, axis=0).T
    seen_from_below = (x * later_y - later_x * y).sum() < 0
    turned = flat * [-1.0, 1.0] if seen_from_below else flat
    return np.array(ring)[np.asarray(manifold3d.triangulate([turned]))]
