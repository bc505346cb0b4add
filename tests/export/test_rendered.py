"""Files opened and rendered by Blender; the pictures are left in out/rendered for people to look at."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from garden import COPIES, garden

from dipcg.generators import load_generator
from dipcg.images import load_image

SHOTS = Path(__file__).parents[2] / "out" / "rendered"
needs_blender = pytest.mark.skipif(bool(load_generator("chair").missing), reason="Infinigen is not installed")


@needs_blender
@pytest.mark.blender
@pytest.mark.parametrize("suffix", [".glb", ".usdz"])
def test_blender_shows_each_part_in_its_colour_and_every_copy(tmp_path, suffix):
    block, seed = (0.1, 0.2, 0.8), (0.9, 0.1, 0.05)
    path = replace(garden(spread=2.0, size=3.0), colours={"block": block, "seed": seed}).export(
        tmp_path / f"garden{suffix}"
    )
    SHOTS.mkdir(parents=True, exist_ok=True)
    target = SHOTS / f"blender-{suffix[1:]}.png"
    done = subprocess.run([sys.executable, "-c", RENDER, path, target], capture_output=True, text=True, check=False)
    assert target.exists(), done.stderr
    picture = load_image(target).astype(float)
    shown = picture[picture[..., 3] > 250][:, :3]
    blue, red = shown[:, 2] > 1.5 * shown[:, 0], shown[:, 0] > 1.5 * shown[:, 2]
    assert (blue | red).mean() > 0.97
    assert red.sum() > 100
    # In even light the colours come out as they went in.
    np.testing.assert_allclose(np.median(shown[blue], axis=0) / 255, block, atol=0.03)
    np.testing.assert_allclose(np.median(shown[red], axis=0) / 255, seed, atol=0.03)


# White light from all around, and each colour as it is: what arrives at a convex matt surface is its colour.
RENDER = """
import os, sys
import bpy
from mathutils import Vector

source, target = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
read = bpy.ops.import_scene.gltf if source.endswith("glb") else bpy.ops.wm.usd_import
read(filepath=source)
scene = bpy.context.scene
for material in bpy.data.materials:
    for node in material.node_tree.nodes:
        if node.type == "BSDF_PRINCIPLED":
            node.inputs["Specular IOR Level"].default_value = 0
scene.world = bpy.data.worlds.new("white")
scene.world.use_nodes = True
scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.location = 4, -5, 3
camera.rotation_euler = (Vector((0, 0, 0.9)) - camera.location).to_track_quat("-Z", "Y").to_euler()
scene.collection.objects.link(camera)
scene.camera = camera
scene.render.engine, scene.cycles.samples, scene.render.film_transparent = "CYCLES", 16, True
scene.cycles.max_bounces = 0
scene.render.resolution_x = scene.render.resolution_y = 192
scene.view_settings.view_transform, scene.render.filepath = "Standard", target
bpy.ops.render.render(write_still=True)
os._exit(0)
"""


@needs_blender
@pytest.mark.blender
def test_blender_reads_instances_for_the_graphics_card(tmp_path):
    path = garden().export(tmp_path / "garden.glb", gpu_instancing=True)
    done = subprocess.run([sys.executable, "-c", COUNT, path], capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1:] == [str(1 + COPIES)], done.stderr


COUNT = """
import os, sys
import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=sys.argv[1])
print(sum(one.type == "MESH" for one in bpy.data.objects), flush=True)
os._exit(0)
"""
