"""Triangle meshes with a part per face: metres, Z up, the front towards -Y."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float32, Int32, UInt8

# How much a change of a normal counts for the simplifier. Less, and flat faces take the shading of a rounded edge.
NORMAL_WEIGHT = 0.03


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


def simplify(mesh: Mesh, faces: int = 4000, error: float = 0.004) -> Mesh:
    """Collapse edges until `faces` are left or the surface would move by more than `error` of its extent.

    Each part is simplified on its own, so part borders survive; a part keeps its share of the budget.
    Source: Garland & Heckbert 1997, quadric error metrics, as implemented by meshoptimizer.
    """
    if len(mesh.faces) <= faces:
        return mesh
    return compact(simplify_parts(weld(mesh), faces / len(mesh.faces), error * mesh.side))


def simplify_parts(mesh: Mesh, share: float, metres: float, normals: Float32[np.ndarray, "v 3"] | None = None) -> Mesh:
    """Simplify each part of a welded mesh to a share of its faces, or until its surface would move by some metres.

    With `normals` of the vertices a change of the shading counts too. The vertices stay the same, some of them without
    a face.
    """
    left = [_simplify_part(mesh, part, share, metres, normals) for part in range(len(mesh.part_names))]
    parts = np.repeat(np.arange(len(left)), [len(faces) for faces in left]).astype(np.uint8)
    return Mesh(mesh.vertices, np.concatenate(left), parts, mesh.part_names)


def weld(mesh: Mesh, tolerance: float = 1e-5) -> Mesh:
    """Put vertices on a grid of `tolerance` of the longest side, merge those that meet, drop faces left without area.

    The simplifier does not move vertices that share a place: without welding, slats had 6,000 faces instead of 300.
    """
    grid = np.rint((mesh.vertices - mesh.bounds[0]) / (tolerance * mesh.side)).astype(np.int64)
    # One number sorts ten times faster than three.
    keys = (grid[:, 0] << 40) | (grid[:, 1] << 20) | grid[:, 2]
    _, first, merged = np.unique(keys, return_index=True, return_inverse=True)
    faces = merged.astype(np.int32)[mesh.faces]
    solid = (faces != np.roll(faces, 1, axis=1)).all(1)
    vertices = grid[first] * (tolerance * mesh.side) + mesh.bounds[0]
    return Mesh(vertices.astype(np.float32), faces[solid], mesh.parts[solid], mesh.part_names)


def drop_degenerate(mesh: Mesh, area: float = 1e-14) -> Mesh:
    """The same mesh without triangles of less than `area` square metres."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    solid = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 2 * area
    return chosen(mesh, solid)


def compact(mesh: Mesh) -> Mesh:
    """The same surface without unused vertices, faces sorted by part."""
    order = np.argsort(mesh.parts, kind="stable")
    used, faces = np.unique(mesh.faces[order], return_inverse=True)
    return replace(chosen(mesh, order), vertices=mesh.vertices[used], faces=faces.reshape(-1, 3).astype(np.int32))


def differs(a: Mesh, b: Mesh, share: float = 1e-5) -> bool:
    """Whether the shapes differ by more than rounding, which is a share of the longest side."""
    if a.vertices.shape != b.vertices.shape or a.faces.shape != b.faces.shape:
        return True
    return bool(np.abs(a.vertices - b.vertices).max() > share * a.side) or not np.array_equal(a.faces, b.faces)


def sort_faces(mesh: Mesh) -> Mesh:
    """The same mesh with its faces in an order of our own, because Blender's may depend on memory addresses."""
    assert mesh.normals is None, "faces are turned, and the normals of their corners would have to turn too"
    faces, order = sort_triangles(mesh.faces, mesh.parts)
    return replace(chosen(mesh, order), faces=faces)


def sort_triangles(triangles: np.ndarray, *ties: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles `f 3` that start at their lowest vertex, sorted, and the position of each before."""
    first = triangles.argmin(1)[:, None]
    turned = np.take_along_axis(triangles, (first + np.arange(3)) % 3, 1)
    order = np.lexsort((*ties, *turned.T[::-1]))
    return turned[order], order


def _simplify_part(
    mesh: Mesh, part: int, share: float, metres: float, normals: Float32[np.ndarray, "v 3"] | None
) -> Int32[np.ndarray, "k 3"]:
    import meshoptimizer

    faces = mesh.faces[mesh.parts == part]
    if not len(faces):
        return faces
    out = np.zeros(faces.size, np.uint32)
    shape: Any = [out, np.ascontiguousarray(faces, np.uint32).ravel(), mesh.vertices]
    # Sparse, so that the work depends on the vertices of the part and not of the mesh. Absolute, so that the error is
    # in metres, the same for every part.
    limits: dict[str, Any] = {
        "target_index_count": 3 * int(share * len(faces)),
        "target_error": metres,
        "options": meshoptimizer.SIMPLIFY_SPARSE | meshoptimizer.SIMPLIFY_ERROR_ABSOLUTE,
    }
    if normals is None:
        count = meshoptimizer.simplify(*shape, **limits)
    else:
        _declare_types()
        weights = np.full(3, NORMAL_WEIGHT, np.float32)
        count = meshoptimizer.simplify_with_attributes(*[*shape, normals, weights], **limits)
    return out[:count].reshape(-1, 3).astype(np.int32)


@cache
def _declare_types() -> None:
    """Declare the types of a function of meshoptimizer, without which its own wrapper fails or crashes."""
    from ctypes import c_float, c_size_t, c_uint, c_void_p

    from meshoptimizer.simplifier import lib

    size, place = c_size_t, c_void_p
    inputs = (place, place, size, place, size, size, place, size, place, size, place)
    lib.meshopt_simplifyWithAttributes.argtypes = (*inputs, size, c_float, c_uint, place)
    lib.meshopt_simplifyWithAttributes.restype = size


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
