"""Convex hulls around the solids of an asset, with the names by which game engines take them for collision shapes.

A hull is a part of the mesh like others, so every format with named parts holds it. Programs that do not know the names
show the hulls.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from dipcg.mesh import Mesh, Solid, chosen, join
from dipcg.mesh.copies import solids
from dipcg.mesh.simplify import weld
from dipcg.mesh.surface import Maps, corner_normals

Engine = Literal["unreal", "godot"]
# By engine, the name of a hull around a part.
NAMES = {"unreal": "UCX_{part}_{number:02d}", "godot": "{part}_{number:02d}-convcolonly"}
# A part with more solids than these has one hull around them all.
MOST_SOLIDS = 16
# A hull has at most one vertex for each of these directions. Engines take up to 255.
DIRECTIONS = 96


def with_hulls(mesh: Mesh, maps: Maps | None, engine: Engine) -> tuple[Mesh, Maps | None]:
    """The mesh with a hull around each solid of each part, and its maps with places for them."""
    hulls = join(list(_hulls(mesh, NAMES[engine])))
    joined = join(
        [Solid("", mesh.vertices, mesh.faces, mesh.quads, mesh.copies), Solid("", hulls.vertices, hulls.faces)]
    )
    parts = np.concatenate([mesh.parts, hulls.parts + np.uint8(len(mesh.part_names))])
    turned = corner_normals(hulls)
    normals = None if mesh.normals is None else np.concatenate([mesh.normals, turned])
    names = (*mesh.part_names, *hulls.part_names)
    return replace(joined, parts=parts, part_names=names, normals=normals), maps and _with_places(maps, turned)


def _hulls(mesh: Mesh, name: str) -> Iterator[Solid]:
    from trimesh.convex import convex_hull

    whole = weld(mesh)
    for part, part_name in enumerate(mesh.part_names):
        for number, points in enumerate(_clouds(chosen(whole, whole.parts == part)), 1):
            hull = convex_hull(points[np.unique((points @ _directions().T).argmax(0))])
            yield Solid(name.format(part=part_name, number=number), hull.vertices, hull.faces)


def _clouds(mesh: Mesh) -> list[Float[np.ndarray, "p 3"]]:
    """The vertices of each solid of a mesh, or of all together where there are many; none that are flat."""
    each, labels = np.unique(solids(mesh), return_inverse=True)
    alike = [labels == number for number in range(len(each))] if len(each) <= MOST_SOLIDS else [labels >= 0]
    clouds = [mesh.vertices[np.unique(mesh.faces[faces])].astype(float) for faces in alike]
    return [cloud for cloud in clouds if np.linalg.matrix_rank(cloud - cloud[0], tol=1e-4 * mesh.side) == 3]


def _directions() -> Float[np.ndarray, "k 3"]:
    """Unit vectors all around, on a spiral, and along the diagonals of a box."""
    step = np.arange(DIRECTIONS - 8) + 0.5
    height, turn = 1 - 2 * step / len(step), step * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - height**2)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3)
    return np.concatenate([np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height]), corners])


def _with_places(maps: Maps, normals: np.ndarray) -> Maps:
    nowhere = np.zeros((len(normals), 3, 2), np.float32)
    return replace(maps, uv=np.concatenate([maps.uv, nowhere]), corners=np.concatenate([maps.corners, normals]))
