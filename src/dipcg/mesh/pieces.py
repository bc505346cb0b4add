"""A mesh as files hold it: named parts and shapes with copies, with quads, normals, and places on a map."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int, Int32

from dipcg.mesh import Mesh, chosen
from dipcg.mesh.copies import Places, find_copies, without_copies
from dipcg.mesh.simplify import drop_degenerate
from dipcg.mesh.surface import Maps, corner_normals, crosses, same_rows


@dataclass(frozen=True)
class Piece:
    """A part, or a shape with copies: normals and places on the maps of each corner, and as in `Mesh` the quads."""

    part: int
    name: str
    vertices: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    normals: Float32[np.ndarray, "f 3 3"]
    uv: Float32[np.ndarray, "f 3 2"]
    quads: Int32[np.ndarray, " f"] | None = None
    places: Places | None = None


@dataclass(frozen=True)
class Split:
    """A piece with a vertex for each place, normal and place on the maps, as glTF has it."""

    vertices: Float32[np.ndarray, "v 3"]
    normals: Float32[np.ndarray, "v 3"]
    uv: Float32[np.ndarray, "v 2"]
    faces: Int32[np.ndarray, "f 3"]


def pieces(mesh: Mesh, maps: Maps | None = None, copies: bool = False) -> Iterator[Piece]:
    """Each part that has faces with some area, with a unique name; with `copies` also each shape that has copies."""
    found = find_copies(mesh) if copies and maps is None else []
    rest, names = without_copies(mesh, found) & (_areas(mesh) > 1e-14), unique_names(mesh.part_names)
    for part, name in enumerate(names):
        here = np.flatnonzero(rest & (mesh.parts == part))
        if len(here):
            uv = None if maps is None else maps.uv[here]
            yield _piece(part, name, chosen(mesh, here), uv)
        for alike in found:
            if mesh.parts[alike.faces[0, 0]] == part:
                own = f"{name}_copies" if len(here) else name
                yield replace(_piece(part, own, drop_degenerate(alike.shape(mesh))), places=alike.places)


def polygons(faces: Int32[np.ndarray, "f 3"], quads: Int32[np.ndarray, " f"] | None) -> tuple[np.ndarray, np.ndarray]:
    """Sizes of the polygons, quads first, and their corners in one row, as indices into `faces.ravel()`."""
    halves = _halves(quads) if quads is not None else np.empty((0, 2), int)
    alone = np.ones(len(faces), bool)
    alone[halves] = False
    corners = 3 * np.flatnonzero(alone)[:, None] + np.arange(3)
    sizes = np.repeat([4, 3], [len(halves), len(corners)])
    return sizes, np.concatenate([_outlines(faces, halves).ravel(), corners.ravel()])


def _halves(quads: Int32[np.ndarray, " f"]) -> Int[np.ndarray, "q 2"]:
    """The two faces of each quad that still has both."""
    order = np.argsort(quads, kind="stable")
    same = np.flatnonzero((np.diff(quads[order]) == 0) & (quads[order][1:] >= 0))
    return np.column_stack([order[same], order[same + 1]])


def _outlines(faces: Int32[np.ndarray, "f 3"], halves: Int[np.ndarray, "q 2"]) -> Int[np.ndarray, "q 4"]:
    """The corners around each quad: those of its first half, with that of the second half that the first lacks."""
    first, second = faces[halves[:, 0]], faces[halves[:, 1]]
    lone = (first[:, :, None] != second[:, None]).all(2).argmax(1)
    other = (second[:, :, None] != first[:, None]).all(2).argmax(1)
    start = 3 * halves[:, 0]
    around = [start + (lone + step) % 3 for step in range(3)]
    return np.column_stack([around[0], around[1], 3 * halves[:, 1] + other, around[2]])


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


def _piece(part: int, name: str, mesh: Mesh, uv: np.ndarray | None = None) -> Piece:
    normals = corner_normals(mesh) if mesh.normals is None else mesh.normals
    used, faces = np.unique(mesh.faces, return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    projected = _projected(mesh) if uv is None else uv
    return Piece(part, name, mesh.vertices[used], faces, normals, projected.astype(np.float32), mesh.quads)


def split(piece: Piece) -> Split:
    """The piece with its vertices split where normals or places on the maps differ."""
    corners = piece.vertices[piece.faces].reshape(-1, 3)
    normals, uv = piece.normals.reshape(-1, 3), piece.uv.reshape(-1, 2)
    columns = np.column_stack([corners, np.round(normals, 3), uv]).astype(np.float32)
    first, faces = same_rows(columns + np.float32(0))
    return Split(corners[first], normals[first], uv[first], faces.reshape(-1, 3).astype(np.int32))


def _projected(mesh: Mesh) -> Float[np.ndarray, "f 3 2"]:
    """Places on a map of one square metre that repeats: each face, or quad, seen along the axis that it faces most.

    Nothing is stretched by more than a square root of three, and a pattern has one size on all parts.
    """
    facing = crosses(mesh)
    if mesh.quads is not None:
        halves = _halves(mesh.quads)
        facing[halves] = facing[halves].sum(1, keepdims=True)
    axis = np.abs(facing).argmax(1)
    # For each axis the two others as the right and the up of the map, and the side from which right is turned round.
    right, up = np.array([1, 0, 0])[axis], np.array([2, 2, 1])[axis]
    turned = np.take_along_axis(facing, axis[:, None], 1)[:, 0] * np.array([1, -1, 1])[axis] < 0
    corners = mesh.vertices[mesh.faces]
    seen = np.stack([np.take_along_axis(corners, which[:, None, None], 2)[..., 0] for which in (right, up)], axis=2)
    return seen * np.where(turned, -1, 1)[:, None, None] ** np.array([1, 0])


def _areas(mesh: Mesh) -> Float[np.ndarray, " f"]:
    return np.linalg.norm(crosses(mesh), axis=1) / 2
