"""The topology of a mesh: triangles, open edges, edges of more than two faces, and the quads of its file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dipcg.mesh import Mesh
from dipcg.mesh.simplify import weld


@dataclass(frozen=True)
class Topology:
    """Counts over the mesh with vertices at one place merged."""

    triangles: int
    open_edges: int
    """edges of one face alone, where the surface ends"""
    non_manifold_edges: int
    """edges of more than two faces"""

    @property
    def watertight(self) -> bool:
        """Whether every edge lies between two faces."""
        return not self.open_edges and not self.non_manifold_edges


def topology(mesh: Mesh) -> Topology:
    """Count edges by the number of their faces; vertices within 1/100,000 of the longest side are one."""
    faces = weld(mesh).faces
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, sharing = np.unique(edges, axis=0, return_counts=True)
    return Topology(len(mesh.faces), int((sharing == 1).sum()), int((sharing > 2).sum()))


def quads_in(path: Path) -> float | None:
    """The share of the faces of an OBJ or PLY file that have four corners; None for formats of triangles alone."""
    suffix = path.suffix.lower()
    return {".obj": _quads_in_obj, ".ply": _quads_in_ply}[suffix](path) if suffix in (".obj", ".ply") else None


def _quads_in_obj(path: Path) -> float | None:
    corners = [len(line.split()) - 1 for line in path.read_text().splitlines() if line.startswith("f ")]
    return corners.count(4) / len(corners) if corners else None


def _quads_in_ply(path: Path) -> float | None:
    """From the number of faces in the header and of triangles that they make; larger polygons would count as quads."""
    import trimesh

    found = re.search(rb"element face (\d+)", path.read_bytes())
    faces = int(found[1]) if found else 0
    mesh = trimesh.load(path, process=False, force="mesh")
    assert isinstance(mesh, trimesh.Trimesh)
    return (len(mesh.faces) - faces) / faces if faces else None
