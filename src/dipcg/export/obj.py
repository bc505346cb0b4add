"""Assets as OBJ with a material file, as importers assume them: Y up, an object and a material for each part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from dipcg.export.scene import Scene, y_up
from dipcg.materials import Finish
from dipcg.mesh.pieces import Piece, polygons


def write_obj(scene: Scene, path: Path) -> None:
    """Write .obj, and .mtl beside it; quads stay quads. Raises OSError."""
    materials = path.with_suffix(".mtl")
    lines, before = [f"# {scene.name}, metres, Y up", f"mtllib {materials.name}"], np.zeros(3, int)
    for piece in scene.pieces:
        rows, count = _object(piece, scene.finish(piece).name, before)
        lines += rows
        before += count
    used = {piece.part: scene.finish(piece) for piece in scene.pieces}
    materials.write_text("\n".join(_material(finish) for finish in used.values()))
    path.write_text("\n".join([*lines, ""]))


def _object(piece: Piece, material: str, before: Int[np.ndarray, "3"]) -> tuple[list[str], Int[np.ndarray, "3"]]:
    """The lines of a piece, and how many vertices, places on the map and normals they have."""
    uv, uv_of = np.unique(piece.uv.reshape(-1, 2).round(6), axis=0, return_inverse=True)
    normals, normal_of = np.unique(y_up(piece.normals).reshape(-1, 3).round(4), axis=0, return_inverse=True)
    corners = np.column_stack([piece.faces.ravel(), uv_of.ravel(), normal_of.ravel()]) + before + 1
    sizes, order = polygons(piece.faces, piece.quads)
    named = np.array(["/".join(map(str, corner)) for corner in corners.tolist()])[order]
    rows = [f"o {piece.name}", *_numbers("v", y_up(piece.vertices), 7), *_numbers("vt", uv, 6)]
    rows += [*_numbers("vn", normals, 4), f"usemtl {material}"]
    rows += ["f " + " ".join(face) for face in np.split(named, np.cumsum(sizes)[:-1])]
    return rows, np.array([len(piece.vertices), len(uv), len(normals)])


def _numbers(kind: str, rows: Float[np.ndarray, "n k"], digits: int) -> list[str]:
    return [f"{kind} " + " ".join(f"{value:.{digits}g}" for value in row) for row in rows.tolist()]


def _material(finish: Finish) -> str:
    """A material of the specification of 1995, with the roughness and metallic that importers read besides."""
    colour = " ".join(f"{value:.4g}" for value in finish.colour)
    shine = 0.04 + 0.96 * finish.metallic
    return (
        f"newmtl {finish.name}\nKd {colour}\nKs {shine:.2g} {shine:.2g} {shine:.2g}\n"
        f"Ns {1000 * (1 - finish.roughness) ** 2:.4g}\nPr {finish.roughness}\nPm {finish.metallic}\nillum 2\n"
    )
