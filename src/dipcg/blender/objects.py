"""Blender objects that a program made, as one mesh, and an empty Blender before each run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from dipcg.mesh import Mesh, MeshError, make_mesh, triangulate
from dipcg.mesh.order import sort_faces


def clean() -> None:
    """Remove all data of earlier runs; what a program leaves in Blender must not change its next run."""
    import bpy

    data = bpy.data
    for blocks in (data.objects, data.meshes, data.curves, data.node_groups, data.materials, data.textures):
        data.batch_remove(blocks)
    for blocks in (data.images, data.collections, data.actions, data.shape_keys, data.lights, data.cameras):
        if len(blocks):
            data.batch_remove(blocks)
    bpy.context.scene.cursor.location = (0, 0, 0)


def is_scene(made: Any) -> bool:
    """Whether a program made Blender objects."""
    import bpy

    many = made if isinstance(made, (list, tuple)) else [made]
    return made is None or all(isinstance(one, (bpy.types.Object, bpy.types.Collection)) for one in many)


def read_scene(made: Any) -> Mesh:
    """The surfaces of objects, their children and their instances, in world axes; of all objects for None.

    Raises MeshError when they have none.
    """
    import bpy

    graph = bpy.context.evaluated_depsgraph_get()
    graph.update()
    wanted = {one.name for one in _with_children(made)}
    pieces = [
        _read(instance)
        for instance in graph.object_instances
        if (instance.parent or instance.object).name in wanted and instance.object.type in _SURFACES
    ]
    pieces = [(vertices, faces) for vertices, faces in pieces if len(faces)]
    if not pieces:
        raise MeshError("The generator built no usable mesh: its objects have no faces.")
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in pieces])
    faces = np.concatenate([faces + start for (_, faces), start in zip(pieces, starts, strict=False)])
    return sort_faces(make_mesh(np.concatenate([vertices for vertices, _ in pieces]), faces))


_SURFACES = ("MESH", "CURVE", "SURFACE", "META", "FONT")


def _with_children(made: Any) -> Iterator[Any]:
    import bpy

    if made is None:
        yield from bpy.context.scene.objects
        return
    for one in made if isinstance(made, (list, tuple)) else [made]:
        objects = one.all_objects if isinstance(one, bpy.types.Collection) else [one]
        for obj in objects:
            yield obj
            yield from obj.children_recursive


def _read(instance: Any) -> tuple[np.ndarray, np.ndarray]:
    obj = instance.object
    mesh = obj.to_mesh()
    if mesh is None:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    corners, sizes = np.empty(len(mesh.loops), np.int32), np.empty(len(mesh.polygons), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.polygons.foreach_get("loop_total", sizes)
    obj.to_mesh_clear()
    matrix = np.array(instance.matrix_world, np.float64)
    faces = triangulate(sizes, corners)[0] if len(sizes) else np.zeros((0, 3), np.int32)
    return vertices.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3], faces
