"""Copies within a mesh: solids that are one shape in several places, such as seeds, which files then hold once.

A generator says which faces are a copy, or else each connected solid may be one. What counts is the comparison: solids
with equal faces are copies when one turned, scaled and moved to the place of another meets it at every vertex.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from dipcg.mesh import Mesh, chosen

# Fewer copies are not worth a node each.
LEAST = 8
# The largest distance between a vertex and its image, in longest sides of the mesh.
TOLERANCE = 1e-5
# The number of shapes that solids with equal faces are compared with.
MOST_SHAPES = 8


@dataclass(frozen=True)
class Places:
    """Where copies are: each vertex of the shape is scaled along its axes, turned, and moved; in metres."""

    scale: Float[np.ndarray, "k 3"]
    rotation: Float[np.ndarray, "k 3 3"]
    translation: Float[np.ndarray, "k 3"]

    def put(self, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "k v 3"]:
        """The vertices of every copy."""
        return (vertices * self.scale[:, None]) @ self.rotation.swapaxes(1, 2) + self.translation[:, None]

    def turn(self, normals: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "k v 3"]:
        """The unit normals of every copy."""
        turned = (normals / self.scale[:, None]) @ self.rotation.swapaxes(1, 2)
        return turned / np.linalg.norm(turned, axis=2, keepdims=True)

    def matrices(self) -> Float[np.ndarray, "k 4 4"]:
        """The places as matrices that multiply columns."""
        matrices = np.tile(np.eye(4), (len(self.scale), 1, 1))
        matrices[:, :3, :3] = self.rotation * self.scale[:, None]
        matrices[:, :3, 3] = self.translation
        return matrices

    def chosen(self, which: np.ndarray) -> Places:
        """Some of the places."""
        return Places(self.scale[which], self.rotation[which], self.translation[which])


@dataclass(frozen=True)
class Copies:
    """The faces of each copy in the mesh, and where it is. The shape is the first copy, moved to the origin."""

    faces: Int[np.ndarray, "k f"]
    places: Places

    def shape(self, mesh: Mesh) -> Mesh:
        """The faces of the first copy, moved to the origin; the mesh has vertices of no face."""
        return replace(chosen(mesh, self.faces[0]), vertices=mesh.vertices - self.places.translation[0].astype("f4"))


def find_copies(mesh: Mesh) -> list[Copies]:
    """All shapes with at least `LEAST` copies, without mirror images."""
    return [copies for alike in _equal_faces(mesh) for copies in _compared(mesh, alike)]


def without_copies(mesh: Mesh, found: list[Copies]) -> np.ndarray:
    """A mask of the faces of no copy."""
    rest = np.ones(len(mesh.faces), bool)
    for copies in found:
        rest[copies.faces] = False
    return rest


def solids(mesh: Mesh) -> Int[np.ndarray, " f"]:
    """For each face the number of the connected solid it belongs to."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])
    links = coo_array((np.ones(len(edges), bool), edges.T), (len(mesh.vertices), len(mesh.vertices)))
    return connected_components(links, directed=False)[1][mesh.faces[:, 0]]


def _equal_faces(mesh: Mesh) -> Iterator[Int[np.ndarray, "k f"]]:
    """Solids of a part whose faces name the same of their own vertices, a row of faces of the mesh for each."""
    labels = solids(mesh) if mesh.copies is None else mesh.copies
    order = np.argsort(labels, kind="stable")
    order = order[labels[order] >= 0]
    ends = np.flatnonzero(np.diff(labels[order])) + 1
    alike: dict[tuple[int, bytes], list[np.ndarray]] = {}
    for faces in np.split(order, ends) if len(ends) + 1 >= LEAST else []:
        own = mesh.faces[faces]
        alike.setdefault((int(mesh.parts[faces[0]]), (own - own.min()).tobytes()), []).append(faces)
    yield from (np.stack(rows) for rows in alike.values() if len(rows) >= LEAST)


def _compared(mesh: Mesh, faces: Int[np.ndarray, "k f"]) -> Iterator[Copies]:
    """Those that are copies of the first, then those that are copies of the first of the others, and so on."""
    own = mesh.faces[faces]
    first = own.min((1, 2))
    points = mesh.vertices[first[:, None] + np.arange(own[0].max() - own[0].min() + 1)].astype(float)
    for _ in range(MOST_SHAPES):
        if len(points) < LEAST:
            return
        places, same = _fitted(points, TOLERANCE * mesh.side)
        if same.sum() >= LEAST:
            yield Copies(faces[same], places.chosen(same))
        # The first is not its own copy when it is flat; it must not be tried again.
        same[0] = True
        points, faces = points[~same], faces[~same]


def _fitted(points: Float[np.ndarray, "k v 3"], tolerance: float) -> tuple[Places, np.ndarray]:
    """The place of each solid as a copy of the first, and which of them are within the tolerance.

    The best linear map of the first onto each is found by least squares. Its rows are the images of the axes.
    """
    middle = points.mean(1)
    centred = points - middle[:, None]
    axes = np.linalg.pinv(centred[0], rcond=1e-4) @ centred
    scale = np.linalg.norm(axes, axis=2)
    rotation = (axes / np.maximum(scale, 1e-12)[..., None]).swapaxes(1, 2)
    places = Places(scale, rotation, middle)
    near = np.abs(places.put(centred[0]) - points).max((1, 2)) <= tolerance
    square = np.abs(rotation @ rotation.swapaxes(1, 2) - np.eye(3)).max((1, 2)) < 1e-3
    return places, near & square & (np.linalg.det(rotation) > 0)
