"""Standard detail: the full surface with far fewer triangles, and with its normals.

A flat or evenly bent surface needs few triangles, and the normals of the full surface make up for the rest. Copies are
simplified once and stay copies. Edges survive, because moving them would cost more than the tolerance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float32, Int

from dipcg.mesh import Mesh, Solid, chosen, join
from dipcg.mesh.copies import Copies, find_copies, solids, without_copies
from dipcg.mesh.simplify import compact, simplify_parts, weld
from dipcg.mesh.surface import corner_normals, vertex_normals

# How far the simplifier may move the surface, as a share of the longest side: its own mean error by quadrics.
TOLERANCE = 0.0003
# A solid longer than so many times what the simplifier may move keeps this share of its length.
LONG, KEPT = 4.0, 0.8


def standard(mesh: Mesh, tolerance: float = TOLERANCE) -> Mesh:
    """The mesh simplified as far as the surface stays within a tolerance, with the normals of the full surface.

    `tolerance` is a share of the longest side, for a shape with copies of its own: the simplifier would shorten threads
    that are thinner than the tolerance, such as those of a seed.
    """
    found = find_copies(mesh)
    rest = chosen(mesh, without_copies(mesh, found))
    pieces = [_simplified(rest, tolerance * mesh.side)] if len(rest.faces) else []
    return _joined([*pieces, *(_copied(mesh, copies, tolerance) for copies in found)], mesh.part_names)


def _simplified(mesh: Mesh, metres: float) -> Mesh:
    # Vertices of no face would make the grid of `weld` coarser.
    full = weld(compact(mesh))
    small = _with_threads(full, metres, vertex_normals(full))
    return compact(replace(small, normals=corner_normals(small, full=full)))


def _with_threads(full: Mesh, metres: float, normals: Float32[np.ndarray, "v 3"]) -> Mesh:
    """The welded mesh simplified, where a solid that is long and thin, and would vanish, is simplified less."""
    small = simplify_parts(full, 0.0, metres, normals)
    numbers = np.full(len(full.vertices), -1)
    numbers[full.faces] = solids(full)[:, None]
    before, after = (_lengths(mesh, numbers) for mesh in (full, small))
    lost = (before > LONG * metres) & (after < KEPT * before)
    if not lost.any():
        return small
    threads = _with_threads(chosen(full, lost[numbers[full.faces[:, 0]]]), metres / 3, normals)
    rest = chosen(small, ~lost[numbers[small.faces[:, 0]]])
    faces, parts = (np.concatenate([getattr(one, name) for one in (rest, threads)]) for name in ("faces", "parts"))
    return Mesh(full.vertices, faces, parts, full.part_names)


def _lengths(mesh: Mesh, numbers: Int[np.ndarray, " v"]) -> Float[np.ndarray, " s"]:
    """The longest side of each solid, by the solid of each vertex; 0 for one without a face."""
    low, high = np.full((numbers.max() + 1, 3), np.inf), np.full((numbers.max() + 1, 3), -np.inf)
    used = np.unique(mesh.faces)
    np.minimum.at(low, numbers[used], mesh.vertices[used])
    np.maximum.at(high, numbers[used], mesh.vertices[used])
    return np.maximum(high - low, 0).max(1)


def _copied(mesh: Mesh, copies: Copies, tolerance: float) -> Mesh:
    """All copies of a shape, simplified within a share of its own longest side."""
    places, full = copies.places, compact(copies.shape(mesh))
    shape = _simplified(full, tolerance * full.side)
    count, size = len(copies.faces), len(shape.vertices)
    assert shape.normals is not None
    return Mesh(
        places.put(shape.vertices).reshape(-1, 3).astype(np.float32),
        (shape.faces + size * np.arange(count)[:, None, None]).reshape(-1, 3).astype(np.int32),
        np.tile(shape.parts, count),
        mesh.part_names,
        copies=np.repeat(np.arange(count, dtype=np.int32), len(shape.faces)),
        normals=places.turn(shape.normals.reshape(-1, 3)).reshape(-1, 3, 3).astype(np.float32),
    )


def _joined(meshes: list[Mesh], part_names: tuple[str, ...]) -> Mesh:
    """One mesh of several with the same names of parts."""
    solids = [Solid("", mesh.vertices, mesh.faces, copies=mesh.copies) for mesh in meshes]
    parts = np.concatenate([mesh.parts for mesh in meshes])
    return replace(join(solids), parts=parts, part_names=part_names, normals=_normals(meshes))


def _normals(meshes: list[Mesh]) -> Float32[np.ndarray, "f 3 3"]:
    given = [mesh.normals for mesh in meshes if mesh.normals is not None]
    return np.concatenate(given)
