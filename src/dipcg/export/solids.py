"""Assets as one closed surface for printers and simulators, PLY and STL: Z up, neighbours share their vertices."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from dipcg.mesh import Mesh, chosen
from dipcg.mesh.pieces import polygons
from dipcg.mesh.simplify import compact

# Vertices that are equal when rounded to so many digits after the point, in metres, are one.
DIGITS = 7


def write_ply(mesh: Mesh, path: Path) -> None:
    """Write a .ply in text, in which quads stay quads, with the number of the part of each face.

    Not every reader takes faces of different sizes in the binary form. Raises OSError.
    """
    mesh = _merged(mesh)
    sizes, corners = polygons(mesh.faces, mesh.quads)
    names = [f"comment part {number} {name}" for number, name in enumerate(mesh.part_names)]
    lines = ["ply", "format ascii 1.0", "comment metres, Z up", *names]
    lines += [f"element vertex {len(mesh.vertices)}", *(f"property float {axis}" for axis in "xyz")]
    lines += [f"element face {len(sizes)}", "property list uchar int vertex_indices", "property uchar part"]
    lines += ["end_header", *(" ".join(f"{value:.8g}" for value in row) for row in mesh.vertices.tolist())]
    parts, starts = mesh.parts[corners // 3].tolist(), (np.cumsum(sizes) - sizes).tolist()
    own = mesh.faces.ravel()[corners].tolist()
    for start, size in zip(starts, sizes.tolist(), strict=True):
        lines.append(" ".join(map(str, (size, *own[start : start + size], parts[start]))))
    path.write_text("\n".join([*lines, ""]))


def write_stl(mesh: Mesh, path: Path) -> None:
    """Write a binary .stl. Raises OSError."""
    import trimesh

    mesh = _merged(mesh)
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)


def _merged(mesh: Mesh) -> Mesh:
    """The mesh with vertices at one place merged.

    Slivers in bevels stay, because a closed surface would be open without them.
    """
    _, first, merged = np.unique(mesh.vertices.round(DIGITS), axis=0, return_index=True, return_inverse=True)
    faces = merged.reshape(-1).astype(np.int32)[mesh.faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(1)
    return compact(chosen(replace(mesh, vertices=mesh.vertices[first], faces=faces), whole))
