"""Make the example pictures with Blender's Cycles: chairs of chosen parameters on a white floor, one as a drawing too,
and a random asset of each other generator in Infinigen's materials before blue.

Run with `python examples/make_images.py`, or with names of generators for theirs alone; needs `pip install
'dipcg[infinigen]'`.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from dipcg.camera import View, camera_position
from dipcg.generators import load_generator
from dipcg.images import MARGIN, edges, load_image, save_image
from dipcg.mesh import Mesh
from dipcg.workers.pool import BuildPool
from dipcg.workers.rpc import Blender

FOLDER = Path(__file__).parent / "images"
CHAIRS = {
    "chair": (
        View(32, 18, 3.0),
        {"back_type": "horizontal-bar", "back_profile_horizontal_ncuts": 4, "has_arm": "0", "leg_type": "straight",
         "leg_height": 0.45, "width": 0.46, "has_leg_x_bar": "1", "has_leg_y_bar": "1",
         "leg_thickness": 0.04, "thickness": 0.05},
    ),
    "armchair": (
        View(-40, 22, 2.5),
        {"back_type": "partial", "back_profile_partial": 0.5, "has_arm": "1", "leg_type": "down-curved",
         "leg_height": 0.45, "width": 0.6, "has_leg_x_bar": "0", "has_leg_y_bar": "0", "thickness": 0.08},
    ),
}  # fmt: skip
MATERIALS = {"seat": (0.42, 0.12, 0.06), "leg": (0.32, 0.17, 0.08), "back": (0.36, 0.2, 0.1), "arm": (0.32, 0.17, 0.08),
             "bar": (0.32, 0.17, 0.08)}  # fmt: skip
# The seed of the parameters and of the materials, and a camera.
OTHERS = {
    "table": (6, View(25, 18, 3.0)), "vase": (7, View(0, 14, 3.0)), "basket": (14, View(35, 28, 3.0)),
    "flower": (3, View(20, 35, 3.0)), "dandelion": (3, View(10, 6, 3.5)),
}  # fmt: skip
SIDE, SAMPLES, COLOURS = 320, 16, 192
# The background's colour.
SKY = np.array([96, 130, 170])
# Long enough for a busy machine.
PATIENCE_S = 3600.0


def main(names: list[str]) -> None:
    if not names or "chair" in names:
        chairs()
    with Blender() as blender:
        for name, (seed, view) in OTHERS.items():
            if not names or name in names:
                photograph_in_materials(blender, name, seed, view)


def photograph_in_materials(blender: Blender, name: str, seed: int, view: View) -> None:
    """A random asset; in light detail, whose triangles cannot be told apart at this size."""
    with BuildPool(name, timeout_s=PATIENCE_S) as pool:
        generator = pool.generator
        mesh = pool.build(generator.space.sample(np.random.default_rng(seed)), "light")
    asked = (mesh, generator.ref, seed, view, SIDE, SAMPLES, MARGIN)
    image = blender.call("scene:photograph", *asked, timeout_s=PATIENCE_S)
    alpha = image[..., 3:] / 255
    # A white object cannot be cut out from a white ground.
    picture = (image[..., :3] * alpha + SKY * (1 - alpha)).astype(np.uint8)
    # A palette halves the size of the file.
    drawn = Image.fromarray(picture).quantize(COLOURS)
    drawn.save(FOLDER / f"{name}.png", optimize=True)


def chairs() -> None:
    generator = load_generator("chair")
    FOLDER.mkdir(exist_ok=True)
    for number, (name, (view, settings)) in enumerate(CHAIRS.items()):
        params = generator.space.replace(generator.space.sample(np.random.default_rng(number)), settings)
        photograph(generator.build(params), view, FOLDER / f"{name}.png")
    save_image(edges(load_image(FOLDER / "armchair.png")), FOLDER / "sketch.png")


def photograph(mesh: Mesh, view: View, path: Path, size: int = 512) -> None:
    """Render with soft light on a white floor."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    for part, name in enumerate(mesh.part_names):
        _add_part(name, mesh.vertices, mesh.faces[mesh.parts == part], MATERIALS[name])
    floor = mesh.bounds[0, 2]
    _add_part("floor", np.array([[-50, -50, floor], [50, -50, floor], [50, 50, floor], [-50, 50, floor]]),
              np.array([[0, 1, 2], [0, 2, 3]]), (0.9, 0.9, 0.9))  # fmt: skip
    _add_camera(view, mesh)
    world = scene.world = bpy.data.worlds.new("white")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (1, 1, 1, 1)
    world.node_tree.nodes["Background"].inputs[1].default_value = 0.9
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.data.angle, sun.rotation_euler = 2.5, 0.3, (0.6, 0.35, 0.5)
    scene.collection.objects.link(sun)
    scene.render.engine, scene.cycles.samples = "CYCLES", 48
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.filepath = str(path.resolve())
    bpy.ops.render.render(write_still=True)


def _add_part(name: str, vertices: np.ndarray, faces: np.ndarray, colour: tuple) -> None:
    import bpy

    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Roughness"].default_value = 0.45
    mesh.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def _add_camera(view: View, mesh: Mesh) -> None:
    import bpy
    from mathutils import Vector  # pyright: ignore[reportMissingImports]

    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.angle = np.radians(view.fov_deg)
    position = Vector(camera_position(view, mesh.centre, mesh.side).tolist())
    camera.location = position
    camera.rotation_euler = (position - Vector(mesh.centre.tolist())).to_track_quat("Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


if __name__ == "__main__":
    main(sys.argv[1:])
