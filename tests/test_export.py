"""Written assets, read back: axes, units, parts, surface; and what cannot be written is refused early."""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dipcg.export import FORMATS, Asset, ExportError, check_target
from dipcg.generators import load_generator
from dipcg.mesh import Mesh, make_mesh
from dipcg.render import PALETTE
from dipcg.space import params_from_json
from dipcg.worker import BuildPool

GLTF_FROM_OURS = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # glTF: Y up, the front towards +Z

every_format = pytest.mark.parametrize("suffix", FORMATS)


@pytest.fixture(scope="module")
def asset() -> Asset:
    """A box with a lid and legs: three parts, no two sides of equal length."""
    box = load_generator("box")
    changes = {"width": 0.5, "depth": 0.8, "top": "pyramid", "overhang": 0.1, "has_legs": True, "leg_height": 0.3}
    params = box.space.replace(box.space.sample(np.random.default_rng(0)), changes)
    with BuildPool("box") as pool:
        return Asset(pool.build(params), "box", params)


def area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def glb_json(path: Path) -> dict:
    """The JSON chunk of a binary glTF file, by the specification alone."""
    data = path.read_bytes()
    magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    return json.loads(data[20 : 20 + size])


@pytest.mark.parametrize("name", ["a.glb", "a.gltf", "A.GLB"])
def test_gltf_is_y_up_and_in_metres(asset, tmp_path, name):
    scene = trimesh.load(asset.export(tmp_path / name))
    turned = asset.mesh.bounds @ GLTF_FROM_OURS.T
    np.testing.assert_allclose(scene.bounds, np.sort(turned, axis=0), atol=1e-6)
    front = asset.mesh.vertices[asset.mesh.vertices[:, 1].argmin()]
    assert (GLTF_FROM_OURS @ front)[2] == pytest.approx(scene.bounds[1, 2], abs=1e-6)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl"])
def test_the_other_formats_are_z_up_and_in_metres(asset, tmp_path, suffix):
    read = trimesh.load(asset.export(tmp_path / f"a{suffix}"))
    np.testing.assert_allclose(read.bounds, asset.mesh.bounds, atol=1e-6)


@every_format
def test_every_format_has_the_same_surface(asset, tmp_path, suffix):
    read = trimesh.load(asset.export(tmp_path / f"a{suffix}"))
    assert read.area == pytest.approx(area(asset.mesh), rel=1e-5)


def test_a_glb_has_a_named_geometry_and_material_for_each_part(asset, tmp_path):
    document = glb_json(asset.export(tmp_path / "a.glb"))
    names = ["body", "leg", "lid"]
    assert sorted(mesh["name"] for mesh in document["meshes"]) == names
    assert sorted(material["name"] for material in document["materials"]) == names
    assert {node["name"] for node in document["nodes"]} >= set(names)
    for mesh in document["meshes"]:
        material = document["materials"][mesh["primitives"][0]["material"]]
        assert material["name"] == mesh["name"]
        colour = PALETTE[asset.mesh.part_names.index(mesh["name"])]
        np.testing.assert_allclose(material["pbrMetallicRoughness"]["baseColorFactor"], [*colour, 1], atol=1 / 255)


def test_parts_keep_their_places_in_a_glb(asset, tmp_path):
    scene = trimesh.load(asset.export(tmp_path / "a.glb"))
    for part, name in enumerate(asset.mesh.part_names):
        points = asset.mesh.vertices[asset.mesh.faces[asset.mesh.parts == part]].reshape(-1, 3) @ GLTF_FROM_OURS.T
        (node,) = scene.graph.geometry_nodes[name]
        placed = scene.geometry[name].copy().apply_transform(scene.graph[node][0])
        np.testing.assert_allclose(placed.bounds, [points.min(0), points.max(0)], atol=1e-6)


@every_format
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


# Refused before any work


@pytest.mark.parametrize("name", ["chair.fbx", "chair", "chair.glb.zip", ".glb"])
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
        asset.export(tmp_path / "chair.fbx")
    assert list(tmp_path.iterdir()) == []
