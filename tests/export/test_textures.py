"""Written maps, read back by trimesh, USD and Khronos' validator."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dipcg.export.asset import USD

every_usd = pytest.mark.parametrize("suffix", USD)


def test_a_glb_holds_the_maps_and_where_each_corner_lies_on_them(textured, tmp_path):
    scene = trimesh.load(textured.export(tmp_path / "a.glb"))
    assert (tmp_path / "a.glb").read_bytes().count(b'"image/png"') == 3
    for part, name in enumerate(textured.mesh.part_names):
        piece, material = scene.geometry[name], scene.geometry[name].visual.material
        uv = textured.maps.uv[textured.mesh.parts == part]
        np.testing.assert_allclose(piece.visual.uv[piece.faces], uv, atol=1e-6)
        np.testing.assert_array_equal(np.array(material.baseColorTexture), textured.maps.base_colour)
        np.testing.assert_array_equal(np.array(material.normalTexture), textured.maps.normal)
        rough = np.array(material.metallicRoughnessTexture)
        np.testing.assert_array_equal(rough[..., 1], textured.maps.roughness)
        np.testing.assert_array_equal(rough[..., 2], textured.maps.metallic)


@every_usd
def test_usd_finds_its_maps(textured, tmp_path, suffix):
    pytest.importorskip("pxr")
    from pxr import Ar, Usd, UsdGeom, UsdShade

    stage = Usd.Stage.Open(str(textured.export(tmp_path / f"a{suffix}")))
    resolver, found = Ar.GetResolver(), {}
    for prim in stage.Traverse():
        if prim.IsA(UsdShade.Shader) and UsdShade.Shader(prim).GetIdAttr().Get() == "UsdUVTexture":
            path = UsdShade.Shader(prim).GetInput("file").Get().resolvedPath
            found[prim.GetName()] = bytes(resolver.OpenAsset(Ar.ResolvedPath(path)).GetBuffer())
        if prim.IsA(UsdGeom.Mesh):
            uv = textured.maps.uv[textured.mesh.parts == textured.mesh.part_names.index(prim.GetName())]
            places = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st")
            assert places.GetInterpolation() == "faceVarying"
            np.testing.assert_allclose(np.array(places.Get()), uv.reshape(-1, 2), atol=1e-6)
    assert sorted(found) == ["base_colour", "metallic", "normal", "roughness"]
    assert all(content.startswith(b"\x89PNG") for content in found.values())


# Khronos


@pytest.fixture(scope="session")
def validator() -> tuple[str, Path]:
    """Node, and the folder of Khronos' validator, which npm fetches once."""
    node, npm = shutil.which("node"), shutil.which("npm")
    folder = Path.home() / ".cache/dipcg/npm"
    if not node or not npm:
        pytest.skip("Node and npm are not installed")
    if not (folder / "node_modules/gltf-validator").is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        command = [npm, "install", "--no-audit", "--no-fund", "--prefix", str(folder), "gltf-validator@2.0.0-dev.3.10"]
        if subprocess.run(command, capture_output=True, timeout=60, check=False).returncode:
            pytest.skip("npm cannot fetch gltf-validator")
    return node, folder


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("kind", ["asset", "textured"])
def test_khronos_validator_finds_nothing_wrong(validator, request, tmp_path, suffix, kind):
    node, folder = validator
    path = request.getfixturevalue(kind).export(tmp_path / f"a{suffix}")
    done = subprocess.run([node, "-e", VALIDATE, str(path)], cwd=folder, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    # Tangents are MikkTSpace's in all viewers; without maps the places on a map wait for those of a person.
    expected = {"MESH_PRIMITIVE_GENERATED_TANGENT_SPACE"} if kind == "textured" else {"UNUSED_OBJECT"}
    assert {message["code"] for message in found["issues"]["messages"]} <= expected
    assert found["info"]["totalTriangleCount"] == len(request.getfixturevalue(kind).mesh.faces)


VALIDATE = """
const bytes = new Uint8Array(require("fs").readFileSync(process.argv[1]));
require("gltf-validator").validateBytes(bytes).then((report) => console.log(JSON.stringify(report)));
"""
