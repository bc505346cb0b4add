"""A mesh as files hold it: parts whose vertices have normals, and with texture maps also places on them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int, Int32, UInt8

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


@dataclass(frozen=True)
class Piece:
    """A part with its number in the mesh; vertices are split where normals or places on the maps differ."""

    part: int
    name: str
    vertices: Float32[np.ndarray, "v 3"]
    normals: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    uv: Float32[np.ndarray, "v 2"] | None = None


def pieces(mesh: Mesh, maps: Maps | None = None) -> Iterator[Piece]:
    """Each part that has faces with some area, with a unique name."""
    corners, solid = corner_normals(mesh) if maps is None else maps.corners, _areas(mesh) > 1e-14
    for part, name in enumerate(unique_names(mesh.part_names)):
        here = np.flatnonzero(solid & (mesh.parts == part))
        if len(here):
            yield _piece(part, name, mesh.vertices[mesh.faces[here]], corners[here], maps and maps.uv[here])


def corner_normals(mesh: Mesh, crease_deg: float = CREASE_DEG) -> Float32[np.ndarray, "f 3 3"]:
    """For each corner of each face the mean, by area, of the normals around it within the angle of the crease."""
    corners = mesh.vertices[mesh.faces].astype(float)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit, places = _unit(cross), _places(mesh.vertices)[mesh.faces].ravel()
    total, creased = _around(places, cross, unit, crease_deg)
    for number, other in _neighbours(places[creased]):
        corner, face = creased[number], creased[other] // 3
        near = np.einsum("ij,ij->i", unit[corner // 3], unit[face]) > np.cos(np.radians(crease_deg))
        total[corner[near]] += cross[face[near]]
    smooth = _unit(np.where((total**2).sum(1, keepdims=True) > 0, total, np.repeat(unit, 3, axis=0)))
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


def unique_names(names: tuple[str, ...]) -> list[str]:
    """The same names, with a number behind those that occur before."""
    different: list[str] = []
    for name in names:
        number = 2
        unique = name
        while unique in different:
            unique, number = f"{name}_{number}", number + 1
        different.append(unique)
    return different


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
    return _same(vertices + np.float32(0))[1]


def _piece(part: int, name: str, positions: np.ndarray, normals: np.ndarray, uv: np.ndarray | None) -> Piece:
    columns = [positions.reshape(-1, 3), np.round(normals.reshape(-1, 3), 3)]
    columns += [] if uv is None else [uv.reshape(-1, 2)]
    first, faces = _same(np.column_stack(columns).astype(np.float32) + np.float32(0))
    places = None if uv is None else uv.reshape(-1, 2)[first].astype(np.float32)
    vertices, split = columns[0][first].astype(np.float32), normals.reshape(-1, 3)[first].astype(np.float32)
    return Piece(part, name, vertices, split, faces.reshape(-1, 3).astype(np.int32), places)


def _same(rows: Float32[np.ndarray, "n k"]) -> tuple[Int[np.ndarray, " u"], Int[np.ndarray, " n"]]:
    """The first of each set of equal rows, and the set of each row, by a hash of 64 bits of each row."""
    multipliers = np.random.default_rng(0).integers(1, 2**63, rows.shape[1], np.uint64) | np.uint64(1)
    keys = np.zeros(len(rows), np.uint64)
    for column, multiplier in zip(np.ascontiguousarray(rows.T).view(np.uint32), multipliers, strict=True):
        keys = (keys ^ column) * multiplier
        keys ^= keys >> np.uint64(29)
    _, first, member = np.unique(keys, return_index=True, return_inverse=True)
    return first, member.ravel()


def _areas(mesh: Mesh) -> Float[np.ndarray, " f"]:
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(float) for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), [0.0, 0.0, 1.0])
