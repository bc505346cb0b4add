"""Our meshes as Blender objects with materials: saved as a file, or drawn with Cycles; it runs in a child process."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import UInt8

from dipcg.blender.infinigen import silence
from dipcg.blender.materials import materials
from dipcg.camera import View, fit, world_to_camera
from dipcg.mesh import Mesh, make_mesh
from dipcg.mesh.surface import corner_normals

Report = Callable[[float, str], None]
# The custom property of an object that holds the parameters of an asset.
PARAMETERS = "dipcg"
SENSOR_MM = 36.0
MAX_THREADS = 16


def photograph(
    _: Report, mesh: Mesh, generator: str, seed: int, view: View, size: int, samples: int, margin: float
) -> UInt8[np.ndarray, "size size 4"]:
    """A picture with Infinigen's materials and random light, framed as `render.Renderer` does with a margin."""
    new_object(mesh, generator, seed)
    return _drawn(mesh, seed, view, size, samples, margin)


def photograph_file(
    _: Report, path: str, seed: int, view: View, size: int, samples: int, margin: float
) -> UInt8[np.ndarray, "size size 4"]:
    """A picture of a GLB as Blender reads it."""
    empty_file()
    import bpy

    with silence():
        bpy.ops.import_scene.gltf(filepath=path)
    shapes = [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]
    points = [[*(obj.matrix_world @ vertex.co)] for obj in shapes for vertex in obj.data.vertices]
    return _drawn(make_mesh(points, [[0, 1, 2]]), seed, view, size, samples, margin)


def new_object(mesh: Mesh, generator: str, seed: int) -> Any:
    """The mesh with smooth normals and materials, alone in an empty file."""
    empty_file()
    import bpy

    shape = bpy.data.meshes.new("asset")
    shape.from_pydata(mesh.vertices, [], mesh.faces)
    for material in materials(generator, mesh.part_names, seed):
        shape.materials.append(material)
    shape.polygons.foreach_set("material_index", mesh.parts.astype(np.int32))
    shape.normals_split_custom_set(corner_normals(mesh).reshape(-1, 3))
    obj = bpy.data.objects.new("asset", shape)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    return obj


def start_cycles(samples: int) -> Any:
    """The scene set to Cycles on the processor; the same seed gives the same picture."""
    import bpy

    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", samples, 0
    scene.render.threads_mode = "FIXED"
    scene.render.threads = min(len(os.sched_getaffinity(0)), MAX_THREADS)
    return scene


def save(target: str) -> None:
    """Save the open file as a Blender file, without a backup of an earlier one.

    Raises ValueError with a sentence.
    """
    import bpy

    bpy.context.preferences.filepaths.save_version = 0
    try:
        with silence():
            bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath(target), check_existing=False, compress=True)
    except RuntimeError as error:
        raise ValueError(f"Blender cannot write {target}: {str(error).strip().splitlines()[-1]}") from None


def _camera(mesh: Mesh, view: View, margin: float) -> Any:
    """A camera whose lens and shift give the off-centre projection of `camera.fit`."""
    import bpy
    from mathutils import Matrix

    to_camera = world_to_camera(view, mesh.centre, mesh.side)
    projection = fit(mesh.vertices, to_camera, margin)
    camera = bpy.data.cameras.new("camera")
    camera.sensor_width, camera.lens = SENSOR_MM, SENSOR_MM * projection[0, 0] / 2
    camera.shift_x, camera.shift_y = projection[0, 2] / 2, projection[1, 2] / 2
    camera.clip_start, camera.clip_end = 1e-3, 1e3
    obj = bpy.data.objects.new("camera", camera)
    obj.matrix_world = Matrix(np.linalg.inv(to_camera).tolist())
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _light(mesh: Mesh, rng: np.random.Generator, view: View) -> None:
    """A sun or an area lamp on the camera's side of the object, a weaker one beside it, and light from all around."""
    import bpy

    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*rng.uniform(0.8, 1.0, 3), 1.0)
    background.inputs["Strength"].default_value = rng.uniform(0.3, 1.0)
    bpy.context.scene.world = world
    turn = view.azimuth_deg + rng.uniform(-70, 70)
    kind = str(rng.choice(["SUN", "AREA"]))
    _lamp(mesh, kind, View(turn, rng.uniform(25, 70), rng.uniform(2, 4)), rng.uniform(1.0, 4.0))
    _lamp(mesh, "AREA", View(turn + rng.uniform(90, 270), rng.uniform(10, 60), 3.0), rng.uniform(0.2, 1.0))


def _lamp(mesh: Mesh, kind: str, place: View, strength: float) -> None:
    """A lamp of about the same brightness on the object whatever its kind and distance."""
    import bpy
    from mathutils import Matrix

    lamp = bpy.data.lights.new("lamp", kind)
    if kind == "AREA":
        lamp.size = mesh.side
        strength *= np.pi * (place.distance * mesh.side) ** 2 * 2
    lamp.energy = strength
    obj = bpy.data.objects.new("lamp", lamp)
    obj.matrix_world = Matrix(np.linalg.inv(world_to_camera(place, mesh.centre, mesh.side)).tolist())
    bpy.context.scene.collection.objects.link(obj)


def _drawn(mesh: Mesh, seed: int, view: View, size: int, samples: int, margin: float) -> np.ndarray:
    """A picture of the open file in random light; the mesh says where the object is."""
    import bpy
    from PIL import Image

    scene = start_cycles(samples)
    scene.camera = _camera(mesh, view, margin)
    _light(mesh, np.random.default_rng(seed), view)
    scene.cycles.use_denoising = samples > 1
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.film_transparent = True
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    with tempfile.TemporaryDirectory() as folder, silence():
        scene.render.filepath = f"{folder}/drawn.png"
        bpy.ops.render.render(write_still=True)
        return np.array(Image.open(scene.render.filepath))


def empty_file() -> None:
    """Close the open file, and begin an empty one in metres."""
    with silence():
        import bpy

        bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.unit_settings.system = "METRIC"
