"""The order of faces, and whether two meshes are the same shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dipcg.mesh.mesh import Mesh, chosen


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
