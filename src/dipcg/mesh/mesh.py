"""Triangle meshes with a part per face: metres, Z up, the front towards -Y."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32, Int32, UInt8


class MeshError(ValueError):
    """A built mesh cannot be used; the message says what is wrong with it."""


@dataclass(frozen=True)
class Mesh:
    """Vertices `v 3` in metres, faces `f 3`, and for each face an index into `part_names`.

    Meshes for files also know, for each face, the quad that it is half of and the copy that it belongs to, both -1 for
    none, and the normals of its corners where the surface that it was simplified from says more than its own faces.
    """

    vertices: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    parts: UInt8[np.ndarray, " f"]
    part_names: tuple[str, ...] = ("body",)
    quads: Int32[np.ndarray, " f"] | None = None
    copies: Int32[np.ndarray, " f"] | None = None
    normals: Float32[np.ndarray, "f 3 3"] | None = None

    @cached_property
    def bounds(self) -> Float32[np.ndarray, "2 3"]:
        """Lowest and highest corner of the bounding box, in metres."""
        return np.stack([self.vertices.min(0), self.vertices.max(0)])

    @property
    def centre(self) -> Float32[np.ndarray, "3"]:
        """Centre of the bounding box, in metres."""
        return self.bounds.mean(0)

    @property
    def side(self) -> float:
        """Longest side of the bounding box, in metres."""
        return float(np.ptp(self.bounds, axis=0).max())


def make_mesh(
    vertices: object,
    faces: object,
    parts: object = None,
    part_names: tuple[str, ...] = ("body",),
    quads: object = None,
    copies: object = None,
    normals: object = None,
) -> Mesh:
    """Build a checked mesh from array-likes.

    Raises MeshError with a sentence when it is empty, not finite, or an index is out of range.
    """
    v = _in_threes(np.ascontiguousarray(vertices, np.float32), "vertices")
    f = _in_threes(np.ascontiguousarray(faces, np.int32), "faces")
    p = np.zeros(len(f), np.uint8) if parts is None else np.ascontiguousarray(parts, np.uint8)
    groups = [None if group is None else np.ascontiguousarray(group, np.int32) for group in (quads, copies)]
    n = None if normals is None else np.ascontiguousarray(normals, np.float32)
    problem = _problem(v, f, p, part_names) or _wrong_extras(len(f), groups, n)
    if problem:
        raise MeshError(f"The generator built no usable mesh: {problem}.")
    return Mesh(v, f, p, tuple(part_names), groups[0], groups[1], n)


class Solid(NamedTuple):
    """A piece of a mesh before it is joined: its part, its vertices and faces, its quads and copies as in `Mesh`."""

    part: str
    vertices: np.ndarray
    faces: np.ndarray
    quads: np.ndarray | None = None
    copies: np.ndarray | None = None


def join(solids: Sequence[tuple[Any, ...]]) -> Mesh:
    """One mesh from solids, or (part name, vertices, faces); those of the same name share a part."""
    every = [Solid(*solid) for solid in solids]
    names = tuple(dict.fromkeys(solid.part for solid in every))
    starts = np.cumsum([0] + [len(solid.vertices) for solid in every])
    faces = [np.asarray(solid.faces).reshape(-1, 3) + start for solid, start in zip(every, starts, strict=False)]
    sizes = [len(f) for f in faces]
    parts = np.repeat([names.index(solid.part) for solid in every], sizes)
    made = make_mesh(np.concatenate([solid.vertices for solid in every]), np.concatenate(faces), parts, names)
    quads = numbered([solid.quads for solid in every], sizes)
    return replace(made, quads=quads, copies=numbered([solid.copies for solid in every], sizes))


def numbered(groups: Sequence[np.ndarray | None], sizes: Sequence[int]) -> Int32[np.ndarray, " f"] | None:
    """The groups of several solids, such as quads, numbered through; None where no solid has any."""
    if all(group is None for group in groups):
        return None
    numbered, start = [], 0
    for group, size in zip(groups, sizes, strict=True):
        own = np.full(size, -1, np.int32) if group is None else np.asarray(group, np.int32)
        numbered.append(np.where(own < 0, -1, own + start).astype(np.int32))
        start += int(own.max(initial=-1)) + 1
    return np.concatenate(numbered)


def chosen(mesh: Mesh, faces: np.ndarray) -> Mesh:
    """The mesh with some of its faces, by their numbers or by a mask, in that order; vertices stay."""
    each = ("faces", "parts", "quads", "copies", "normals")
    values = {name: getattr(mesh, name) for name in each}
    return replace(mesh, **{name: value[faces] for name, value in values.items() if value is not None})


def triangulate(sizes: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fan polygons into triangles: polygon sizes and their concatenated corners to faces and source polygons."""
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    source = np.repeat(np.arange(len(sizes)), sizes - 2)
    step = np.arange(len(source)) - np.repeat(np.cumsum(sizes - 2) - (sizes - 2), sizes - 2)
    first = starts[source]
    return np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1), source


def pairs(polygons: Int32[np.ndarray, " f"]) -> Int32[np.ndarray, " f"]:
    """The polygon of each triangle if it has two, so that it is a quad, and -1 for others."""
    return np.where(np.bincount(polygons)[polygons] == 2, polygons, np.int32(-1))


def _in_threes(values: np.ndarray, what: str) -> np.ndarray:
    if values.ndim > 1 and values.shape[1:] != (3,):
        # Quads, for example, would be nonsense when read in threes.
        problem = f"its {what} have the shape {values.shape}, not ({what[0]}, 3)"
        raise MeshError(f"The generator built no usable mesh: {problem}.")
    return values.reshape(-1, 3)


def _problem(v: np.ndarray, f: np.ndarray, p: np.ndarray, part_names: tuple[str, ...]) -> str:
    if not len(v) or not len(f):
        return f"it has {len(v)} vertices and {len(f)} faces"
    if not np.isfinite(v).all():
        return f"{(~np.isfinite(v)).any(1).sum()} of its {len(v)} vertices are not finite"
    if f.min() < 0 or f.max() >= len(v):
        return f"a face names vertex {f.max() if f.max() >= len(v) else f.min()} of {len(v)}"
    if p.shape != (len(f),) or p.max() >= len(part_names):
        return f"its parts do not name one of {len(part_names)} parts for each of {len(f)} faces"
    return ""


def _wrong_extras(count: int, groups: list[np.ndarray | None], normals: np.ndarray | None) -> str:
    if any(group is not None and group.shape != (count,) for group in groups):
        return f"its quads or copies are not one number for each of {count} faces"
    if normals is not None and (normals.shape != (count, 3, 3) or not np.isfinite(normals).all()):
        return f"its normals are not three finite vectors for each of {count} faces"
    return ""
