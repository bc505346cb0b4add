"""What Blender writes, bakes and draws of our meshes, checked by Blender anew and by our own renderer."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dipcg.blender.declaration import live_settings
from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.generators import load_generator
from dipcg.images import MARGIN
from dipcg.materials import FAMILIES, family
from dipcg.mesh.surface import Maps
from dipcg.render import Renderer
from dipcg.workers.pool import BuildPool
from dipcg.workers.rpc import Blender, BlenderError

LAMP = Path(__file__).parents[2] / "examples/lamp.toml"
SEED = 3

needs_blender = pytest.mark.skipif(bool(load_generator("chair").missing), reason="Infinigen is not installed")


@pytest.fixture(scope="module")
def asset() -> Asset:
    box = load_generator("box")
    params = box.space.replace(box.space.sample(np.random.default_rng(0)), {"has_legs": True, "top": "flat"})
    with BuildPool("box") as pool:
        return Asset(pool.build(params), "box", params)


@pytest.fixture(scope="module")
def blender():
    with Blender() as running:
        yield running


@pytest.fixture(scope="module")
def maps(blender, asset) -> Maps:
    said = []
    made = blender.call(
        "bake:bake", asset.mesh, "box", SEED, 32, progress=lambda share, note: said.append((share, note))
    )
    assert [share for share, _ in said] == sorted(share for share, _ in said)
    assert said[-1][1] == "baking normal"
    return made


@pytest.fixture(scope="module")
def opened(blender, asset, tmp_path_factory) -> dict:
    """What a fresh Blender finds in the files that another one wrote."""
    folder = tmp_path_factory.mktemp("blend")
    blender.call("outliner:write_blend", asset.mesh, "box", "box", SEED, "{}", str(folder / "box.blend"))
    _, place, settings = live_settings(LAMP, lamp_params())
    blender.call("geometry_nodes:save_with", place, settings, str(folder / "lamp.blend"))
    command = [sys.executable, "-c", OPEN, str(folder), str(LAMP), json.dumps(lamp_params())]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def lamp_params() -> dict:
    lamp = load_generator(str(LAMP)).space
    return lamp.replace(lamp.sample(np.random.default_rng(1)), {"height": 0.47, "shade": "Dome", "rings": 3})


OPEN = """
import json, os, sys
import bpy, numpy as np
from dipcg.generators import load_generator

folder, lamp, params = sys.argv[1:]

def points(name):
    bpy.ops.wm.open_mainfile(filepath=f"{folder}/{name}.blend")
    (obj,) = [o for o in bpy.data.objects if o.type == "MESH"]
    seen = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return obj, np.array([[*(obj.matrix_world @ v.co)] for v in seen.to_mesh().vertices])

bpy.ops.wm.open_mainfile(filepath=f"{folder}/box.blend")
(root,) = [o for o in bpy.data.objects if o.parent is None]
found = {"root": root.name, "parameters": root["dipcg"], "parts": {}}
for part in root.children:
    faces = [[[*(part.matrix_world @ part.data.vertices[v].co)] for v in p.vertices] for p in part.data.polygons]
    found["parts"][part.name] = {"slots": [m.name for m in part.data.materials], "faces": faces}
obj, vertices = points("lamp")
inputs = {key: value for key, value in obj.modifiers[0].items() if isinstance(value, (int, float))}
found["lamp"] = {"inputs": inputs, "bounds": [vertices.min(0).tolist(), vertices.max(0).tolist()]}
found["built"] = load_generator(lamp).build(json.loads(params)).bounds.tolist()
print(json.dumps(found), flush=True)
os._exit(0)
"""


@needs_blender
@pytest.mark.blender
def test_a_blend_has_a_root_and_an_object_with_a_material_for_each_part(asset, opened):
    assert (opened["root"], opened["parameters"]) == ("box", "{}")
    for part, name in enumerate(asset.mesh.part_names):
        faces = asset.mesh.vertices[asset.mesh.faces[asset.mesh.parts == part]]
        np.testing.assert_allclose(opened["parts"][name]["faces"], faces, atol=1e-6)
        assert opened["parts"][name]["slots"] == ["plastic: PlasticRough"]


@needs_blender
@pytest.mark.blender
def test_a_blend_of_a_blender_file_keeps_the_modifier_with_its_inputs_set(opened):
    inputs = opened["lamp"]["inputs"]
    # The height, by examples/lamp.toml.
    assert inputs["Socket_19"] == pytest.approx(0.47)
    # The number of rings.
    assert inputs["Socket_22"] == 3
    np.testing.assert_allclose(opened["lamp"]["bounds"], opened["built"], atol=1e-5)


@needs_blender
@pytest.mark.blender
def test_baked_maps_are_those_of_the_material_and_lie_apart(asset, maps):
    assert maps.base_colour.shape == maps.normal.shape == (32, 32, 3)
    assert maps.uv.min() >= 0
    assert maps.uv.max() <= 1
    assert maps.metallic.max() == 0, "plastic is no metal"
    assert 0 < maps.roughness.mean() < 255
    up = maps.normal[..., 2]
    assert np.median(up) > 240, "a normal map is mostly flat"
    a, b, c = np.moveaxis(maps.uv.astype(float), 1, 0)
    covered = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum() / 2
    assert 0.1 < covered <= 1, "faces that overlapped on the map could cover more than all of it"


@needs_blender
@pytest.mark.blender
def test_a_textured_glb_has_the_baked_colour(asset, maps, tmp_path):
    scene = trimesh.load(replace(asset, maps=maps).export(tmp_path / "a.glb"))
    for piece in scene.geometry.values():
        np.testing.assert_array_equal(np.array(piece.visual.material.baseColorTexture), maps.base_colour)


@needs_blender
@pytest.mark.blender
def test_cycles_sees_what_our_renderer_sees(asset, blender):
    view = View(35.0, 25.0, 2.0)
    theirs = blender.call("scene:photograph", asset.mesh, "box", SEED, view, 64, 1, MARGIN)
    renderer = Renderer(64)
    ours = renderer.render(asset.mesh, view, margin=MARGIN)[..., 3] > 127
    renderer.close()
    seen = theirs[..., 3] > 127
    assert theirs.shape == (64, 64, 4)
    assert (seen & ours).sum() / (seen | ours).sum() > 0.97
    assert theirs[..., :3][seen].std() > 3, "a lit box has sides of different brightness"


@needs_blender
@pytest.mark.blender
def test_what_blender_refuses_is_a_sentence(blender, asset, tmp_path):
    with pytest.raises(BlenderError, match="Blender cannot write"):
        blender.call("outliner:write_blend", asset.mesh, "box", "box", SEED, "{}", str(tmp_path / "no/folder/a.blend"))
    with pytest.raises(BlenderError, match="cannot open"):
        blender.call("geometry_nodes:save_with", (__file__, "Lamp", "", ()), [], str(tmp_path / "a.blend"))


def test_every_part_of_the_generators_that_ship_has_a_family():
    named = {"chair": ("seat", "leg", "back", "arm", "bar"), "table": ("top", "leg", "stretcher"), "vase": ("body",)}
    named |= {"basket": ("frame",), "flower": ("petal", "centre"), "dandelion": ("stem", "head", "seed")}
    found = {name: {part: family(name, part) for part in parts} for name, parts in named.items()}
    assert {kind for parts in found.values() for kind in parts.values()} <= FAMILIES.keys()
    assert found["chair"]["leg"] == found["chair"]["back"] == "frame"
    assert found["flower"] == {"petal": "petal", "centre": "flower centre"}
    assert family("lamps/lamp.toml", "Brass") == "metal"
    assert family("box", "lid") == "plastic"
