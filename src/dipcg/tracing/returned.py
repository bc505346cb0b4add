"""What a seeded program returned, as one mesh: meshes of other libraries, lists, polygons, or Blender objects."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from dipcg.mesh import Mesh, join, make_mesh, triangulate
from dipcg.mesh.order import sort_faces
from dipcg.tracing.draws import ProgramError


def read(made: Any) -> Mesh:
    """The mesh that a program made, its faces in order.

    Raises ProgramError for what is none, and MeshError for one that cannot be used.
    """
    if "bpy" in sys.modules:
        from dipcg.blender.objects import is_scene, read_scene

        if is_scene(made):
            return read_scene(made)
    return sort_faces(_mesh(made))


def _mesh(made: Any) -> Mesh:
    if isinstance(made, Mesh):
        return made
    if isinstance(made, (list, tuple)) and len(made) and all(hasattr(one, "vertices") for one in made):
        return join([("body", np.asarray(one.vertices), triangles(one.faces)) for one in made])
    vertices, faces = _vertices_and_faces(made)
    return make_mesh(vertices, triangles(faces))


def _vertices_and_faces(made: Any) -> tuple[Any, Any]:
    if hasattr(made, "to_mesh"):
        made = made.to_mesh()
    if hasattr(made, "vertices") and hasattr(made, "faces"):
        return made.vertices, made.faces
    if isinstance(made, Mapping) and {"vertices", "faces"} <= made.keys():
        return made["vertices"], made["faces"]
    try:
        vertices, faces = made
    except (TypeError, ValueError):
        kind = type(made).__name__
        raise ProgramError(f"It returned a {kind}; a mesh, (vertices, faces) or Blender objects are needed.") from None
    return vertices, faces


def triangles(faces: Any) -> np.ndarray:
    """Triangles of polygons of three or more corners, each cut into a fan."""
    sizes = np.array([len(face) for face in faces], np.int32)
    if len(sizes) == 0 or sizes.min() < 3:
        raise ProgramError("Its faces need three corners or more each.")
    return triangulate(sizes, np.concatenate([np.asarray(face, np.int32) for face in faces]))[0]
