"""Simplification: fewer triangles for the same surface."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float32, Int32

from dipcg.mesh.mesh import Mesh, chosen

# How much a change of a normal counts for the simplifier. Less, and flat faces take the shading of a rounded edge.
NORMAL_WEIGHT = 0.03


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
