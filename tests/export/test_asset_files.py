"""Written assets, read back: axes, units, parts, surface; and what cannot be written is refused early."""

import os
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from garden import glb_json

from dipcg.export.asset import TEXTURED, USD, Asset, ExportError, check_faces, check_target, check_texture
from dipcg.materials import finishes as plain_finishes
from dipcg.mesh import Mesh, make_mesh
from dipcg.mesh.surface import corner_normals
from dipcg.parameter_file import params_from_json

# From our axes to Y up with the front towards +Z.
Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])

# The formats that trimesh reads.
every_format = pytest.mark.parametrize("suffix", [".glb", ".gltf", ".obj", ".ply", ".stl"])
every_usd = pytest.mark.parametrize("suffix", USD)


def area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def standing(mesh: Mesh) -> Mesh:
    """The mesh on the floor with its middle over the origin."""
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    return replace(mesh, vertices=mesh.vertices - [*(low + high)[:2] / 2, low[2]])


@pytest.mark.parametrize("name", ["a.glb", "a.gltf", "A.GLB"])
def test_gltf_is_y_up_and_in_metres(asset, tmp_path, name):
    scene = trimesh.load(asset.export(tmp_path / name))
    turned = standing(asset.mesh).bounds @ Y_UP.T
    np.testing.assert_allclose(scene.bounds, np.sort(turned, axis=0), atol=1e-6)
    front = asset.mesh.vertices[asset.mesh.vertices[:, 1].argmin()]
    assert (Y_UP @ front)[2] == pytest.approx(scene.bounds[1, 2], abs=1e-6)


@pytest.mark.parametrize(("suffix", "turn"), [(".obj", Y_UP), (".ply", np.eye(3)), (".stl", np.eye(3))])
def test_the_other_formats_are_in_metres_with_their_usual_axes(asset, tmp_path, suffix, turn):
    read = trimesh.load(asset.export(tmp_path / f"a{suffix}"))
    np.testing.assert_allclose(read.bounds, np.sort(standing(asset.mesh).bounds @ turn.T, axis=0), atol=1e-6)


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply"])
def test_an_asset_stands_on_the_floor_over_the_origin_wherever_it_was_built(asset, tmp_path, suffix):
    moved = replace(asset, mesh=replace(asset.mesh, vertices=asset.mesh.vertices + np.float32([3, -2, -0.7])))
    low, high = trimesh.load(moved.export(tmp_path / f"a{suffix}")).bounds
    up = 2 if suffix == ".ply" else 1
    assert low[up] == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(np.delete(low + high, up), 0, atol=1e-5)


@every_format
def test_every_format_has_the_same_surface(asset, tmp_path, suffix):
    read = trimesh.load(asset.export(tmp_path / f"a{suffix}"))
    assert read.area == pytest.approx(area(asset.mesh), rel=1e-5)


def test_a_glb_has_a_named_geometry_and_material_for_each_part(asset, tmp_path):
    document, nodes = glb_json(asset.export(tmp_path / "a.glb")), ["body", "leg", "lid"]
    assert sorted(mesh["name"] for mesh in document["meshes"]) == nodes
    (root,) = document["scenes"][0]["nodes"]
    assert document["nodes"][root]["name"] == "box"
    assert sorted(document["nodes"][child]["name"] for child in document["nodes"][root]["children"]) == nodes
    finishes = dict(zip(asset.mesh.part_names, plain_finishes("box", asset.mesh.part_names), strict=True))
    for mesh in document["meshes"]:
        material, finish = document["materials"][mesh["primitives"][0]["material"]], finishes[mesh["name"]]
        assert material["name"] == finish.name == f"{mesh['name']}_plastic"
        assert material["pbrMetallicRoughness"]["roughnessFactor"] == finish.roughness
        colour = np.array(finish.colour)
        # Colours in glTF are linear.
        light = np.where(colour > 0.04045, ((colour + 0.055) / 1.055) ** 2.4, colour / 12.92)
        np.testing.assert_allclose(material["pbrMetallicRoughness"]["baseColorFactor"], [*light, 1], atol=1e-6)


def test_parts_keep_their_places_in_a_glb(asset, tmp_path):
    scene = trimesh.load(asset.export(tmp_path / "a.glb"))
    for part, name in enumerate(asset.mesh.part_names):
        points = standing(asset.mesh).vertices[asset.mesh.faces[asset.mesh.parts == part]].reshape(-1, 3) @ Y_UP.T
        (node,) = scene.graph.geometry_nodes[name]
        placed = scene.geometry[name].copy().apply_transform(scene.graph[node][0])
        np.testing.assert_allclose(placed.bounds, [points.min(0), points.max(0)], atol=1e-6)


# The formats with normals; the others keep solids closed.
@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".obj"])
def test_no_face_without_area_is_written(tmp_path, suffix):
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [0, 0, 1]]
    mesh = make_mesh(vertices, [[0, 1, 2], [0, 1, 3], [0, 0, 4], [0, 2, 4]])
    read = trimesh.load(Asset(mesh, "x", {}).export(tmp_path / f"a{suffix}"), force="mesh")
    assert len(read.faces) == 2
    assert read.area_faces.min() == pytest.approx(0.5)


@every_format
def test_assets_of_one_folder_do_not_share_files(asset, tmp_path, suffix):
    asset.export(tmp_path / f"first{suffix}")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    other = make_mesh(asset.mesh.vertices * 2, asset.mesh.faces[:5])
    Asset(other, "x", {}).export(tmp_path / f"second{suffix}")
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    assert trimesh.load(tmp_path / f"first{suffix}").area == pytest.approx(area(asset.mesh), rel=1e-5)


def test_saved_parameters_are_those_of_the_asset(asset, tmp_path):
    text = asset.save_params(tmp_path / "a.json").read_text()
    assert params_from_json(text) == ("box", asset.params)


# Normals


def test_normals_of_a_fine_sphere_point_away_from_its_centre():
    sphere = trimesh.creation.icosphere(subdivisions=4)
    mesh = make_mesh(sphere.vertices, sphere.faces)
    np.testing.assert_allclose(corner_normals(mesh), mesh.vertices[mesh.faces], atol=0.01)


def test_normals_of_a_box_are_those_of_its_faces():
    box = trimesh.creation.box()
    normals = corner_normals(make_mesh(box.vertices, box.faces))
    np.testing.assert_allclose(normals, np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-6)


def test_normals_are_smooth_where_vertices_share_a_place_but_not_a_number():
    sphere = trimesh.creation.icosphere(subdivisions=4)
    mesh = make_mesh(sphere.triangles.reshape(-1, 3), np.arange(3 * len(sphere.faces)).reshape(-1, 3))
    np.testing.assert_allclose(corner_normals(mesh), sphere.triangles, atol=0.01)


@pytest.mark.parametrize("crease_deg", [5.0, 35.0, 120.0])
def test_normals_are_means_by_area_over_the_faces_that_turn_less_than_the_crease(crease_deg):
    """Corner by corner, on a solid that is smooth in places and creased in others."""
    drum = trimesh.creation.cylinder(0.5, 1.0, sections=12)
    drum.vertices += np.random.default_rng(0).normal(0, 0.02, drum.vertices.shape)
    cross = np.cross(*(drum.triangles[:, i] - drum.triangles[:, 0] for i in (1, 2)))
    around = [[(drum.faces == vertex).any(1) for vertex in face] for face in drum.faces]
    near = drum.face_normals @ drum.face_normals.T > np.cos(np.radians(crease_deg))
    means = np.array([[cross[meeting & near[i]].sum(0) for meeting in row] for i, row in enumerate(around)])
    expected = means / np.linalg.norm(means, axis=2, keepdims=True)
    found = corner_normals(make_mesh(drum.vertices, drum.faces), crease_deg)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_a_glb_has_unit_normals_that_agree_with_the_faces(asset, tmp_path):
    for piece in trimesh.load(asset.export(tmp_path / "a.glb")).geometry.values():
        given = piece.vertex_normals[piece.faces]
        np.testing.assert_allclose(np.linalg.norm(given, axis=2), 1, atol=1e-5)
        assert ((given * piece.face_normals[:, None]).sum(2) > 0.8).all()


# Solids


def test_a_closed_box_is_watertight_as_stl(tmp_path):
    box = trimesh.creation.box()
    apart = make_mesh(box.triangles.reshape(-1, 3), np.arange(3 * len(box.faces)).reshape(-1, 3))
    assert trimesh.load(Asset(apart, "x", {}).export(tmp_path / "a.stl")).is_watertight


def test_fewer_faces_keep_the_shape(tmp_path):
    sphere = trimesh.creation.icosphere(subdivisions=5)
    full = Asset(make_mesh(sphere.vertices, sphere.faces), "x", {})
    small = full.with_faces(500)
    assert 400 <= len(small.mesh.faces) <= 500
    assert area(small.mesh) == pytest.approx(area(full.mesh), rel=0.03)
    assert len(full.mesh.faces) == len(sphere.faces)


# USD


@every_usd
def test_usd_is_y_up_in_metres_with_a_mesh_and_a_material_for_each_part(asset, tmp_path, suffix):
    pxr = pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom, UsdShade

    stage = Usd.Stage.Open(str(asset.export(tmp_path / f"a{suffix}")))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetDefaultPrim().GetName() == "box", pxr
    shapes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert sorted(shape.GetPrim().GetName() for shape in shapes) == ["body", "leg", "lid"]
    for shape in shapes:
        name = shape.GetPrim().GetName()
        faces = asset.mesh.faces[asset.mesh.parts == asset.mesh.part_names.index(name)]
        points = np.array(shape.GetPointsAttr().Get())[np.array(shape.GetFaceVertexIndicesAttr().Get())]
        np.testing.assert_allclose(points @ Y_UP, standing(asset.mesh).vertices[faces].reshape(-1, 3), atol=1e-6)
        material, _ = UsdShade.MaterialBindingAPI(shape).ComputeBoundMaterial()
        assert material.GetPath().name == f"{name}_plastic"
        assert material.ComputeSurfaceSource()[0].GetIdAttr().Get() == "UsdPreviewSurface"


@every_usd
def test_a_usd_file_can_be_written_twice(asset, tmp_path, suffix):
    pytest.importorskip("pxr")
    first = asset.export(tmp_path / f"a{suffix}").read_bytes()
    assert asset.export(tmp_path / f"a{suffix}").read_bytes() == first


def test_a_package_of_usd_has_no_date(asset, tmp_path):
    # Files would differ with the clock; a zip file counts in steps of two seconds.
    pytest.importorskip("pxr")
    with zipfile.ZipFile(asset.export(tmp_path / "a.usdz")) as package:
        assert {entry.date_time for entry in package.infolist()} == {(1980, 1, 1, 0, 0, 0)}


@pytest.mark.parametrize("names", [("a part", "a-part"), ("materials", "4 legs")])
def test_usd_finds_a_name_for_every_part(tmp_path, names):
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    mesh = make_mesh(np.eye(3), [[0, 1, 2], [2, 1, 0]], [0, 1], names)
    stage = Usd.Stage.Open(str(Asset(mesh, "x", {}).export(tmp_path / "a.usdc")))
    assert sum(prim.IsA(UsdGeom.Mesh) for prim in stage.Traverse()) == 2


# Refused before any work


@pytest.mark.parametrize("name", ["chair.max", "chair", "chair.glb.zip", ".glb"])
def test_an_unknown_ending_is_refused_with_the_known_ones(tmp_path, name):
    with pytest.raises(ExportError, match=r"no known ending; use one of \.glb, \.gltf, \.obj, \.ply, \.stl"):
        check_target(tmp_path / name)


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(ExportError, match=f"The folder {tmp_path}/a/b does not exist; make it first"):
        check_target(tmp_path / "a" / "b" / "chair.glb")


def test_a_folder_in_the_place_of_the_file_is_refused(tmp_path):
    (tmp_path / "chair.glb").mkdir()
    with pytest.raises(ExportError, match=r"chair\.glb cannot be written"):
        check_target(tmp_path / "chair.glb")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(ExportError, match="cannot be written"):
        check_target(tmp_path / "chair.glb")


def test_checking_leaves_no_file_and_no_change(tmp_path):
    check_target(tmp_path / "new.glb")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old.glb").write_bytes(b"kept")
    check_target(tmp_path / "old.glb")
    assert (tmp_path / "old.glb").read_bytes() == b"kept"


def test_an_asset_is_not_written_where_it_cannot_be(asset, tmp_path):
    with pytest.raises(ExportError, match="no known ending"):
        asset.export(tmp_path / "chair.max")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("suffix", "module"), [(".usdz", "pxr"), (".blend", "bpy")])
def test_a_format_says_what_it_lacks(tmp_path, monkeypatch, suffix, module):
    monkeypatch.setattr("dipcg.export.asset.find_spec", lambda name: None)
    with pytest.raises(ExportError, match=rf"\{suffix} files need the module {module}: run pip install"):
        check_target(tmp_path / f"a{suffix}")


def test_faces_and_maps_are_checked_before_any_work():
    with pytest.raises(ExportError, match="4 or more, got 3"):
        check_faces(3)
    with pytest.raises(ExportError, match="from 16 to 8192 pixels, got 4"):
        check_texture(4, Path("a.glb"))
    with pytest.raises(ExportError, match=r"\.stl files hold no maps; use one of \.glb"):
        check_texture(64, Path("a.stl"))
    assert all(suffix in TEXTURED for suffix in (".glb", *USD))


def test_slivers_do_not_open_a_solid(tmp_path):
    """A box with an edge cut a micrometre from its end: two triangles have no width, and their neighbours need them."""
    box = trimesh.creation.box()
    start, end = box.faces[0, :2]
    middle = box.vertices[start] + 1e-6 * (box.vertices[end] - box.vertices[start])
    cut = [face for face in box.faces if {start, end} <= set(face)]
    rest = [face for face in box.faces if not {start, end} <= set(face)]
    halves = [np.where(face == old, len(box.vertices), face) for face in cut for old in (start, end)]
    mesh = make_mesh([*box.vertices, middle], [*rest, *halves])
    assert trimesh.load(Asset(mesh, "x", {}).export(tmp_path / "a.stl")).is_watertight
