"""Assets as Blender objects that a person understands in the outliner: a root, and below it an object for each part.

Copies of a shape share its data. The module runs in a child process, and writes Blender's files and FBX.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from dipcg.blender.infinigen import silence
from dipcg.blender.materials import materials
from dipcg.blender.scene import PARAMETERS, Report, empty_file, save
from dipcg.materials import linear
from dipcg.mesh import Mesh
from dipcg.mesh.pieces import Piece, pieces, polygons


def write_blend(_: Report, mesh: Mesh, generator: str, name: str, seed: int, params: str, target: str) -> None:
    """Write a Blender file with Infinigen's materials, and the parameters as JSON at the root."""
    empty_file()
    drawn = materials(generator, mesh.part_names, seed)
    _add_asset(mesh, name, drawn)[PARAMETERS] = params
    save(target)


def write_fbx(_: Report, mesh: Mesh, name: str, finishes: list[dict[str, Any]], target: str) -> None:
    """Write an FBX file with plain materials: metres, Y up, as Unreal and Unity read it."""
    import bpy

    empty_file()
    _add_asset(mesh, name, [_plain(**finish) for finish in finishes])
    with silence():
        bpy.ops.export_scene.fbx(
            filepath=os.path.abspath(target),
            object_types={"EMPTY", "MESH"},
            axis_forward="-Z",
            axis_up="Y",
            apply_scale_options="FBX_SCALE_UNITS",
            bake_space_transform=False,
            mesh_smooth_type="OFF",
            add_leaf_bones=False,
        )


def _add_asset(mesh: Mesh, name: str, made: list[Any]) -> Any:
    """The root, an empty, with the parts below it."""
    root = _linked(name, None, None)
    root.empty_display_size = mesh.side / 4
    for piece in pieces(mesh, copies=True):
        data = _data(piece, made[piece.part])
        if piece.places is None:
            _linked(piece.name, data, root)
            continue
        group = _linked(piece.name, None, root)
        for number, matrix in enumerate(piece.places.matrices(), 1):
            _linked(f"{piece.name}_{number}", data, group).matrix_local = _matrix(matrix)
    return root


def _linked(name: str, data: Any, parent: Any) -> Any:
    """A new object in the scene."""
    import bpy

    obj = bpy.data.objects.new(name, data)
    obj.parent = parent
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _data(piece: Piece, material: Any) -> Any:
    """The mesh of a piece, with its quads, normals and places on a map."""
    import bpy

    data = bpy.data.meshes.new(piece.name)
    sizes, corners = polygons(piece.faces, piece.quads)
    ends = np.cumsum(sizes)
    data.from_pydata(piece.vertices, [], np.split(piece.faces.ravel()[corners], ends[:-1]))
    data.materials.append(material)
    layer = data.uv_layers.new(name="UVMap")
    layer.uv.foreach_set("vector", piece.uv.reshape(-1, 2)[corners].astype(np.float32).ravel())
    data.normals_split_custom_set(piece.normals.reshape(-1, 3)[corners])
    return data


def _plain(name: str, colour: list[float], roughness: float, metallic: float) -> Any:
    import bpy

    material = bpy.data.materials.new(name)
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*linear(np.array(colour)).tolist(), 1.0)
    shader.inputs["Roughness"].default_value, shader.inputs["Metallic"].default_value = roughness, metallic
    return material


def _matrix(matrix: np.ndarray) -> Any:
    from mathutils import Matrix

    return Matrix(matrix.tolist())
