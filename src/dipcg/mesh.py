"""Triangle meshes with a part per face: metres, Z up, the front towards -Y."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float32, Int32, UInt8


class MeshError(ValueError):
    """A built mesh cannot be used; the message says what is wrong with it."""


@dataclass(frozen=True)
class Mesh:
    """Vertices `v 3` in metres, faces `f 3`, and for each face an index into `part_names`."""

    vertices: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    parts: UInt8[np.ndarray, " f"]
    part_names: tuple[str, ...] = ("body",)

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


def make_mesh(vertices: object, faces: object, parts: object = None, part_names: tuple[str, ...] = ("body",)) -> Mesh:
    """Build a checked mesh from array-likes.

    Raises MeshError with a sentence when it is empty, not finite, or an index is out of range.
    """
    v = _in_threes(np.ascontiguousarray(vertices, np.float32), "vertices")
    f = _in_threes(np.ascontiguousarray(faces, np.int32), "faces")
    p = np.zeros(len(f), np.uint8) if parts is None else np.ascontiguousarray(parts, np.uint8)
    problem = _problem(v, f, p, part_names)
    if problem:
        raise MeshError(f"The generator built no usable mesh: {problem}.")
    return Mesh(v, f, p, tuple(part_names))


def join(meshes: list[tuple[str, np.ndarray, np.ndarray]]) -> Mesh:
    """One mesh from (part name, vertices, faces) pieces; pieces of the same name share a part."""
    names = tuple(dict.fromkeys(name for name, _, _ in meshes))
    starts = np.cumsum([0] + [len(v) for _, v, _ in meshes])
    faces = [np.asarray(f).reshape(-1, 3) + start for (_, _, f), start in zip(meshes, starts, strict=False)]
    parts = [np.full(len(f), names.index(name)) for (name, _, _), f in zip(meshes, faces, strict=True)]
    return make_mesh(np.concatenate([v for _, v, _ in meshes]), np.concatenate(faces), np.concatenate(parts), names)


def triangulate(sizes: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fan polygons into triangles: polygon sizes and their concatenated corners to faces and source polygons."""
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    source = np.repeat(np.arange(len(sizes)), sizes - 2)
    step = np.arange(len(source)) - np.repeat(np.cumsum(sizes - 2) - (sizes - 2), sizes - 2)
    first = starts[source]
    return np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1), source


def simplify(mesh: Mesh, faces: int = 4000, error: float = 0.004) -> Mesh:
    """Collapse edges until `faces` are left or the surface would move by more than `error` of its extent.

    Each part is simplified on its own, so part borders survive; a part keeps its share of the budget.
    Source: Garland & Heckbert 1997, quadric error metrics, as implemented by meshoptimizer.
    """
    if len(mesh.faces) <= faces:
        return mesh
    share, mesh = faces / len(mesh.faces), weld(mesh)
    left = [_simplify_part(mesh, part, share, error) for part in range(len(mesh.part_names))]
    parts = np.repeat(np.arange(len(left)), [len(faces) for faces in left]).astype(np.uint8)
    return compact(replace(mesh, faces=np.concatenate(left), parts=parts))


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
    return Mesh(mesh.vertices, mesh.faces[solid], mesh.parts[solid], mesh.part_names)


def compact(mesh: Mesh) -> Mesh:
    """The same surface without unused vertices, faces sorted by part."""
    order = np.argsort(mesh.parts, kind="stable")
    used, faces = np.unique(mesh.faces[order], return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    return Mesh(mesh.vertices[used], faces, mesh.parts[order], mesh.part_names)


def differs(a: Mesh, b: Mesh, share: float = 1e-5) -> bool:
    """Whether the shapes differ by more than rounding, which is a share of the longest side."""
    if a.vertices.shape != b.vertices.shape or a.faces.shape != b.faces.shape:
        return True
    return bool(np.abs(a.vertices - b.vertices).max() > share * a.side) or not np.array_equal(a.faces, b.faces)


def sort_faces(mesh: Mesh) -> Mesh:
    """The same mesh with its faces in an order of our own, because Blender's may depend on memory addresses."""
    faces, order = sort_triangles(mesh.faces, mesh.parts)
    return replace(mesh, faces=faces, parts=mesh.parts[order])


def sort_triangles(triangles: np.ndarray, *ties: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles `f 3` that start at their lowest vertex, sorted, and the position of each before."""
    first = triangles.argmin(1)[:, None]
    turned = np.take_along_axis(triangles, (first + np.arange(3)) % 3, 1)
    order = np.lexsort((*ties, *turned.T[::-1]))
    return turned[order], order


def _simplify_part(mesh: Mesh, part: int, share: float, error: float) -> Int32[np.ndarray, "k 3"]:
    import meshoptimizer

    faces = mesh.faces[mesh.parts == part]
    if not len(faces):
        return faces
    out = np.zeros(faces.size, np.uint32)
    # Sparse, so that the work depends on the vertices of the part and not of the mesh. Absolute, so that the error is
    # in metres, the same for every part.
    count = meshoptimizer.simplify(
        out,
        faces.astype(np.uint32).ravel(),
        mesh.vertices,
        target_index_count=3 * int(share * len(faces)),
        target_error=error * mesh.side,
        options=meshoptimizer.SIMPLIFY_SPARSE | meshoptimizer.SIMPLIFY_ERROR_ABSOLUTE,
    )
    return out[:count].reshape(-1, 3).astype(np.int32)


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
