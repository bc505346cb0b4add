"""Assets as one closed surface for printers and simulators, PLY and STL: Z up, neighbours share their vertices."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from dipcg.mesh import Mesh, chosen, compact
from dipcg.pieces import polygons

# Vertices that are equal when rounded to so many digits after the point, in metres, are one.
DIGITS = 7


def write_ply(mesh: Mesh, path: Path) -> None:
    """Write a binary .ply, in which quads stay quads, with the number of the part of each face. Raises OSError."""
    mesh = _merged(mesh)
    sizes, corners = polygons(mesh.faces, mesh.quads)
    split = int(4 * (sizes == 4).sum())
    blocks = [_rows(mesh, corners[:split], 4), _rows(mesh, corners[split:], 3)]
    names = [f"comment part {number} {name}" for number, name in enumerate(mesh.part_names)]
    header = ["ply", "format binary_little_endian 1.0", "comment metres, Z up", *names]
    header += [f"element vertex {len(mesh.vertices)}", *(f"property float {axis}" for axis in "xyz")]
    header += [f"element face {len(sizes)}", "property list uchar int vertex_indices", "property uchar part"]
    text = "\n".join([*header, "end_header", ""]).encode()
    path.write_bytes(text + mesh.vertices.astype("<f4").tobytes() + b"".join(block.tobytes() for block in blocks))


def write_stl(mesh: Mesh, path: Path) -> None:
    """Write a binary .stl. Raises OSError."""
    import trimesh

    mesh = _merged(mesh)
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)


def _rows(mesh: Mesh, corners: np.ndarray, size: int) -> np.ndarray:
    """Polygons of one size as rows of a file: the number of corners, the corners, the part."""
    rows = np.empty(len(corners) // size, [("size", "u1"), ("corners", "<i4", size), ("part", "u1")])
    rows["size"], rows["corners"] = size, mesh.faces.ravel()[corners].reshape(-1, size)
    rows["part"] = mesh.parts[corners.reshape(-1, size)[:, 0] // 3]
    return rows


def _merged(mesh: Mesh) -> Mesh:
    """The mesh with vertices at one place merged.

    Slivers in bevels stay, because a closed surface would be open without them.
    """
    _, first, merged = np.unique(mesh.vertices.round(DIGITS), axis=0, return_index=True, return_inverse=True)
    faces = merged.reshape(-1).astype(np.int32)[mesh.faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(1)
    return compact(chosen(replace(mesh, vertices=mesh.vertices[first], faces=faces), whole))
