"""Quads and copies in files, and standard detail: what independent readers find."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from garden import COPIES, CUBE, cube, garden, glb_json

from dipcg.evaluation.topology import quads_in
from dipcg.export.asset import USD, Asset
from dipcg.generators import load_generator
from dipcg.mesh import make_mesh
from dipcg.mesh.copies import find_copies
from dipcg.mesh.detail import TOLERANCE, standard

needs_blender = pytest.mark.skipif(bool(load_generator("chair").missing), reason="Infinigen is not installed")


@pytest.fixture
def sown() -> Asset:
    return garden()


# Quads


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_evaluate_counts_quads(tmp_path, suffix):
    whole = cube()
    assert quads_in(Asset(whole, "box", {}).export(tmp_path / f"a{suffix}")) == 1
    torn = replace(whole, quads=np.where(whole.quads < 2, -1, whole.quads))
    assert quads_in(Asset(torn, "box", {}).export(tmp_path / f"b{suffix}")) == 4 / 8


def test_an_obj_has_quads(tmp_path):
    path = Asset(cube(), "box", {}).export(tmp_path / "a.obj")
    corners = trimesh.load(path, process=False)
    assert corners.area == pytest.approx(6)
    assert corners.is_watertight or trimesh.Trimesh(corners.vertices, corners.faces).is_watertight


def test_a_quad_that_lost_a_half_is_a_triangle(tmp_path):
    whole = cube()
    torn = replace(whole, faces=whole.faces[1:], parts=whole.parts[1:], quads=whole.quads[1:])
    lines = Asset(torn, "box", {}).export(tmp_path / "a.obj").read_text().splitlines()
    assert sorted(len(line.split()) - 1 for line in lines if line.startswith("f ")) == [3, 4, 4, 4, 4, 4]


def test_a_ply_has_quads_around_a_closed_solid(tmp_path):
    path = Asset(cube(), "box", {}).export(tmp_path / "a.ply")
    faces = [line for line in path.read_text().partition("end_header\n")[2].splitlines() if line.startswith("4 ")]
    assert len(faces) == 6
    assert {len(face.split()) for face in faces} == {1 + 4 + 1}
    read = trimesh.load(path)
    assert read.is_watertight
    assert read.volume == pytest.approx(1)


@pytest.mark.parametrize("suffix", USD)
def test_usd_has_quads_around_which_the_corners_go(tmp_path, suffix):
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(Asset(cube(), "box", {}).export(tmp_path / f"a{suffix}")))
    (shape,) = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert list(shape.GetFaceVertexCountsAttr().Get()) == [4] * 6
    points = np.array(shape.GetPointsAttr().Get())[np.array(shape.GetFaceVertexIndicesAttr().Get())].reshape(6, 4, 3)
    sides = np.linalg.norm(np.roll(points, -1, 1) - points, axis=2)
    np.testing.assert_allclose(sides, 1, atol=1e-6)


# Copies


def test_a_glb_has_a_mesh_once_and_a_node_for_each_copy(sown, tmp_path):
    path = sown.export(tmp_path / "a.glb")
    document = glb_json(path)
    assert [mesh["name"] for mesh in document["meshes"]] == ["block", "seed"]
    assert sum(node.get("mesh") == 1 for node in document["nodes"]) == COPIES
    assert path.stat().st_size < len(sown.mesh.faces) * 12
    read = trimesh.load(path).dump(concatenate=True)
    whole = trimesh.Trimesh(sown.mesh.vertices, sown.mesh.faces)
    assert read.area == pytest.approx(whole.area, rel=1e-4)
    np.testing.assert_allclose(np.ptp(read.bounds, axis=0)[[0, 2, 1]], np.ptp(whole.bounds, axis=0), atol=1e-4)


def test_copies_can_be_one_node_for_the_graphics_card(sown, tmp_path):
    document = glb_json(sown.export(tmp_path / "a.glb", gpu_instancing=True))
    assert document["extensionsUsed"] == ["EXT_mesh_gpu_instancing"]
    (node,) = [node for node in document["nodes"] if "extensions" in node]
    attributes = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    assert {document["accessors"][which]["count"] for which in attributes.values()} == {COPIES}


def test_usd_has_an_instance_for_each_copy_in_its_material(sown, tmp_path):
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom, UsdShade

    stage = Usd.Stage.Open(str(sown.export(tmp_path / "a.usdz")))
    copies = [prim for prim in stage.Traverse() if prim.IsInstance()]
    assert len(copies) == COPIES
    (shape,) = (
        Usd.PrimRange(copies[0], Usd.TraverseInstanceProxies())
        .__iter__()
        .__next__()
        .GetFilteredChildren(Usd.TraverseInstanceProxies())
    )
    material, _ = UsdShade.MaterialBindingAPI(shape).ComputeBoundMaterial()
    assert material.GetPath().name == "seed_plastic"
    box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(stage.GetDefaultPrim())
    size = np.array(box.ComputeAlignedRange().GetSize())
    np.testing.assert_allclose(size[[0, 2, 1]], np.ptp(sown.mesh.bounds, axis=0), atol=0.05)


def test_what_only_looks_like_a_copy_is_none(sown):
    bent = sown.mesh.vertices.copy()
    bent[len(CUBE) :: 642] += 0.01
    assert find_copies(replace(sown.mesh, vertices=bent)) == []


# Standard detail


def test_standard_detail_stays_near_the_surface_with_its_normals():
    ball = trimesh.creation.icosphere(subdivisions=6)
    small = standard(make_mesh(ball.vertices, ball.faces))
    assert len(small.faces) < len(ball.faces) / 5
    # The tolerance is a mean, as a share of the diameter; single triangles are farther.
    distance = np.abs(1 - np.linalg.norm(small.vertices[small.faces].mean(1), axis=1)) / 2
    assert distance.mean() < 1.2 * TOLERANCE
    assert distance.max() < 4 * TOLERANCE
    np.testing.assert_allclose(small.normals, small.vertices[small.faces], atol=0.02)


def test_standard_detail_keeps_creases():
    fine = trimesh.creation.box().subdivide().subdivide().subdivide()
    small = standard(make_mesh(fine.vertices, fine.faces))
    assert len(small.faces) < len(fine.faces) / 5
    assert trimesh.Trimesh(small.vertices, small.faces).volume == pytest.approx(1)
    np.testing.assert_allclose(np.abs(small.normals).max(2), 1, atol=1e-6)


def test_standard_detail_keeps_copies_and_simplifies_them_once(sown):
    small = standard(sown.mesh, tolerance=0.01)
    (copies,) = find_copies(small)
    assert len(copies.faces) == COPIES
    assert 0 < len(copies.faces[0]) < len(find_copies(sown.mesh)[0].faces[0])


# UVs


@pytest.mark.parametrize("suffix", [".glb", ".obj"])
def test_files_without_maps_have_uvs_in_metres(asset, tmp_path, suffix):
    scene = trimesh.load(asset.export(tmp_path / f"a{suffix}"))
    for piece in scene.geometry.values():
        flat = piece.visual.uv[piece.faces]
        edges = [np.roll(corners, -1, 1) - corners for corners in (flat, piece.vertices[piece.faces])]
        lengths = [np.linalg.norm(edge, axis=2) for edge in edges]
        assert (lengths[0] <= lengths[1] + 1e-5).all()
        assert lengths[0].sum() > lengths[1].sum() / np.sqrt(3)


# Blender


@needs_blender
@pytest.mark.blender
@pytest.mark.parametrize("suffix", [".glb", ".usdz", ".fbx", ".blend"])
def test_blender_finds_the_asset_on_its_floor_with_shared_copies(sown, tmp_path, suffix):
    path = sown.export(tmp_path / f"a{suffix}")
    done = subprocess.run([sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    low, high = np.array(found["bounds"])
    np.testing.assert_allclose(high - low, np.ptp(sown.mesh.bounds, axis=0), atol=1e-3)
    assert low[2] == pytest.approx(0, abs=1e-4)
    assert found["meshes"] == 2
    assert {"garden", "block", "seed"} <= set(found["names"])


READ = """
import json, os, sys
import bpy, numpy as np

path = sys.argv[1]
bpy.ops.wm.read_factory_settings(use_empty=True)
read = {"glb": bpy.ops.import_scene.gltf, "fbx": bpy.ops.import_scene.fbx, "usdz": bpy.ops.wm.usd_import}
read.get(path.rpartition(".")[2], bpy.ops.wm.open_mainfile)(filepath=path)
graph = bpy.context.evaluated_depsgraph_get()
points = []
for one in graph.object_instances:
    if one.object.type == "MESH":
        points += [[*(one.matrix_world @ v.co)] for v in one.object.data.vertices]
points = np.array(points)
found = {"bounds": [points.min(0).tolist(), points.max(0).tolist()], "names": [o.name for o in bpy.data.objects]}
found["meshes"] = len({o.data.name for o in bpy.data.objects if o.type == "MESH"})
print(json.dumps(found), flush=True)
os._exit(0)
"""
