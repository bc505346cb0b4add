"""The surface of a mesh: the normals of its corners, and texture maps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from dipcg.mesh import Mesh, MeshError

# Faces that meet at a larger angle have a sharp edge between them.
CREASE_DEG = 35.0


@dataclass(frozen=True)
class Maps:
    """Texture maps, which are square, and the place of each corner of each face on them.

    `uv` has its origin at the lower left, `corners` are normals; `base_colour` is sRGB, `normal` in tangent space with
    +Y up, the rest linear.
    """

    uv: Float32[np.ndarray, "f 3 2"]
    corners: Float32[np.ndarray, "f 3 3"]
    base_colour: UInt8[np.ndarray, "s s 3"]
    roughness: UInt8[np.ndarray, "s s"]
    metallic: UInt8[np.ndarray, "s s"]
    normal: UInt8[np.ndarray, "s s 3"]


def make_maps(**arrays: np.ndarray) -> Maps:
    """Build checked maps from the arrays of their fields; raises MeshError for other types or shapes."""
    maps = Maps(**arrays)
    faces, size = len(maps.uv), len(maps.roughness)
    shapes = {"uv": (faces, 3, 2), "corners": (faces, 3, 3), "base_colour": (size, size, 3), "normal": (size, size, 3)}
    shapes |= dict.fromkeys(("roughness", "metallic"), (size, size))
    for name, shape in shapes.items():
        array, dtype = getattr(maps, name), np.float32 if name in ("uv", "corners") else np.uint8
        if array.shape != shape or array.dtype != dtype or not np.isfinite(array).all():
            raise MeshError(f"These are no maps: {name} is {array.dtype} of shape {array.shape}.")
    return maps


def corner_normals(
    mesh: Mesh, crease_deg: float = CREASE_DEG, full: Mesh | None = None
) -> Float32[np.ndarray, "f 3 3"]:
    """For each corner of each face the mean, by area, of the normals around it within the angle of the crease.

    `full` is the surface that the mesh was simplified from, with the same vertices: its faces are then the ones around.
    """
    if full is not None:
        return _normals_of(full, mesh, crease_deg)
    cross = crosses(mesh)
    unit, places = _unit(cross), _places(mesh.vertices)[mesh.faces].ravel()
    total, creased = _around(places, cross, unit, crease_deg)
    for number, other in _neighbours(places[creased]):
        corner, face = creased[number], creased[other] // 3
        near = np.einsum("ij,ij->i", unit[corner // 3], unit[face]) > np.cos(np.radians(crease_deg))
        total[corner[near]] += cross[face[near]]
    smooth = _unit(np.where((total**2).sum(1, keepdims=True) > 0, total, np.repeat(unit, 3, axis=0)))
    return smooth.reshape(-1, 3, 3).astype(np.float32)


def vertex_normals(mesh: Mesh) -> Float32[np.ndarray, "v 3"]:
    """For each vertex the mean, by area, of the normals of all faces around it."""
    columns = np.repeat(crosses(mesh), 3, axis=0).T
    total = [np.bincount(mesh.faces.ravel(), column, len(mesh.vertices)) for column in columns]
    return _unit(np.column_stack(total)).astype(np.float32)


def _normals_of(full: Mesh, mesh: Mesh, crease_deg: float) -> Float32[np.ndarray, "f 3 3"]:
    own, around = _unit(crosses(mesh)), crosses(full)
    order = np.argsort(full.faces.ravel(), kind="stable")
    count = np.bincount(full.faces.ravel(), minlength=len(full.vertices))
    first = np.cumsum(count) - count
    # A pair for each corner of the mesh and each face of the full surface around its vertex.
    many = count[mesh.faces.ravel()]
    corner = np.repeat(np.arange(len(many)), many)
    step = np.arange(len(corner)) - np.repeat(np.cumsum(many) - many, many)
    face = order[first[mesh.faces.ravel()[corner]] + step] // 3
    near = np.einsum("ij,ij->i", own[corner // 3], _unit(around)[face]) > np.cos(np.radians(crease_deg))
    # A sliver may face where no face around its corner does; then all of them count.
    near |= (np.bincount(corner[near], minlength=len(many)) == 0)[corner]
    total = np.column_stack([np.bincount(corner[near], column, len(many)) for column in around[face[near]].T])
    smooth = _unit(total)
    return smooth.reshape(-1, 3, 3).astype(np.float32)


def _around(
    places: Int[np.ndarray, " c"], cross: Float[np.ndarray, "f 3"], unit: Float[np.ndarray, "f 3"], crease_deg: float
) -> tuple[Float[np.ndarray, "c 3"], Int[np.ndarray, " n"]]:
    """For each corner the sum of the normals at its place, or 0 where there may be a crease, and those corners.

    Where all normals are within half a crease of their sum, no two are a crease apart; that is nearly everywhere.
    """
    weights = np.repeat(cross, 3, axis=0)
    total = np.column_stack([np.bincount(places, column) for column in weights.T])
    off = np.einsum("ij,ij->i", np.repeat(unit, 3, axis=0), _unit(total)[places]) <= np.cos(np.radians(crease_deg / 2))
    creased = np.flatnonzero(np.bincount(places, off)[places])
    sums = total[places]
    sums[creased] = 0
    return sums, creased


def _neighbours(places: Int[np.ndarray, " c"]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Every corner with another at the same place, itself included: one such corner for each at a time.

    The work grows with the number of pairs, the memory with the number of corners.
    """
    order = np.argsort(places, kind="stable")
    count = np.bincount(places)
    first, count = (np.cumsum(count) - count)[places[order]], count[places[order]]
    rank = np.arange(len(order)) - first
    for step in range(int(count.max(initial=0))):
        open_ = np.flatnonzero(count > step)
        yield order[open_], order[first[open_] + (rank[open_] + step) % count[open_]]


def _places(vertices: Float32[np.ndarray, "v 3"]) -> Int[np.ndarray, " v"]:
    """A number for each place at which there are vertices."""
    # The addition turns -0 into 0.
    return same_rows(vertices + np.float32(0))[1]


def same_rows(rows: Float32[np.ndarray, "n k"]) -> tuple[Int[np.ndarray, " u"], Int[np.ndarray, " n"]]:
    """The first of each set of equal rows, and the set of each row, by a hash of 64 bits of each row."""
    multipliers = np.random.default_rng(0).integers(1, 2**63, rows.shape[1], np.uint64) | np.uint64(1)
    keys = np.zeros(len(rows), np.uint64)
    for column, multiplier in zip(np.ascontiguousarray(rows.T).view(np.uint32), multipliers, strict=True):
        keys = (keys ^ column) * multiplier
        keys ^= keys >> np.uint64(29)
    _, first, member = np.unique(keys, return_index=True, return_inverse=True)
    return first, member.ravel()


def crosses(mesh: Mesh) -> Float[np.ndarray, "f 3"]:
    """The normal of each face, as long as twice its area."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    return np.cross(b - a, c - a)


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), [0.0, 0.0, 1.0])
