"""How far one surface lies from another: what counts as a change of a mesh, and what as rounding."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from dipcg.mesh import Mesh
from dipcg.mesh.order import differs

# A difference of less than this share of the longest side is rounding.
TOLERANCE = 1e-5
# Vertices that are compared with the nearest of the other mesh.
POINTS = 1000


def moved(a: Mesh, b: Mesh) -> float:
    """How far a surface moved, as a share of the longest side; 0 where only rounding differs.

    The mean distance between some vertices, nearest to nearest, which also compares meshes of different faces.
    """
    if not differs(a, b, TOLERANCE):
        return 0.0
    there, back = _distances(a, b) / a.side, _distances(b, a) / a.side
    # Blender may list the same vertices in another order.
    if max(there.max(), back.max()) < TOLERANCE and len(a.faces) == len(b.faces):
        return 0.0
    return max(float(there.mean() + back.mean()), TOLERANCE)


def _distances(a: Mesh, b: Mesh) -> Float[np.ndarray, " n"]:
    """From some vertices of a mesh to the nearest of another."""
    return KDTree(b.vertices).query(a.vertices[:: max(1, len(a.vertices) // POINTS)])[0]
