"""What game engines take: levels of detail, hulls for collision, and what is refused; and what Apple's devices take."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from garden import garden, glb_json

from dipcg.export.asset import Asset, ExportError, check_extras
from dipcg.export.collision import DIRECTIONS
from dipcg.mesh import join


def stool() -> Asset:
    """A fine disc on three legs."""
    legs = [trimesh.creation.cylinder(0.03, 0.5, sections=200) for _ in range(3)]
    for leg, place in zip(legs, ([0.2, 0, 0], [-0.1, 0.17, 0], [-0.1, -0.17, 0]), strict=True):
        leg.apply_translation(place)
    seat = trimesh.creation.icosphere(subdivisions=5)
    top = seat.vertices * [0.3, 0.3, 0.05] + [0, 0, 0.3]
    return Asset(join([("seat", top, seat.faces), *(("leg", leg.vertices, leg.faces) for leg in legs)]), "stool", {})


def hulls(path, word: str) -> dict[str, trimesh.Trimesh]:
    scene = trimesh.load(path)
    closed = {name: trimesh.Trimesh(part.vertices, part.faces) for name, part in scene.geometry.items() if word in name}
    for part in closed.values():
        part.merge_vertices(merge_norm=True, merge_tex=True)
    return closed


@pytest.mark.parametrize(
    ("engine", "names"),
    [
        ("unreal", {"UCX_seat_01", "UCX_leg_01", "UCX_leg_02", "UCX_leg_03"}),
        ("godot", {f"{part}-convcolonly" for part in ("seat_01", "leg_01", "leg_02", "leg_03")}),
    ],
)
def test_a_hull_stands_around_each_solid_under_the_name_of_its_engine(tmp_path, engine, names):
    plain = stool()
    found = hulls(plain.with_hulls(engine).export(tmp_path / "a.glb"), "UCX" if engine == "unreal" else "col")
    assert set(found) == names
    for name, hull in found.items():
        assert hull.is_watertight
        assert hull.is_convex, name
        assert len(hull.vertices) <= DIRECTIONS
    low, high = np.array([hull.bounds for hull in found.values()]).min(0)[0], plain.mesh.bounds[1]
    assert low[1] == pytest.approx(0, abs=0.01)
    legs = [hull.volume for name, hull in found.items() if "leg" in name]
    np.testing.assert_allclose(legs, np.pi * 0.03**2 * 0.5, rtol=0.1)
    assert high[2] > 0.3


def test_hulls_leave_the_asset_as_it_was_with_its_normals_and_maps(textured, tmp_path):
    made = textured.with_hulls("unreal")
    assert len(made.maps.uv) == len(made.mesh.faces) == len(made.maps.corners)
    scene = trimesh.load(made.export(tmp_path / "a.glb"))
    before = trimesh.load(textured.export(tmp_path / "b.glb"))
    for name, part in before.geometry.items():
        same = scene.geometry[name]
        np.testing.assert_allclose(same.triangles, part.triangles, atol=1e-5)
        np.testing.assert_allclose(same.visual.uv[same.faces], part.visual.uv[part.faces], atol=1e-6)


def test_many_solids_share_a_hull_and_copies_stay_copies(tmp_path):
    sown = garden()
    document = glb_json(sown.with_hulls("unreal").export(tmp_path / "a.glb"))
    assert [mesh["name"] for mesh in document["meshes"]][:2] == ["block", "seed"]
    assert sum(node.get("mesh") == 1 for node in document["nodes"]) == 12


def test_each_level_of_detail_has_fewer_triangles_and_nearly_the_shape():
    full = stool()
    levels = [full.coarser(level) for level in (1, 2, 3)]
    counts = [len(one.mesh.faces) for one in (full, *levels)]
    assert all(after < before / 1.3 for before, after in pairwise(counts)), counts
    for one in levels:
        np.testing.assert_allclose(one.mesh.bounds, full.mesh.bounds, atol=0.02)
        assert one.mesh.part_names == full.mesh.part_names


@pytest.mark.parametrize(
    ("name", "extras", "sentence"),
    [
        ("a.glb", (4, False, False, False), "up to 3 levels of detail, got 4"),
        ("a.glb", (1, False, False, True), "Levels of detail have no maps"),
        ("a.blend", (1, False, False, False), "Levels of detail have no maps and are no .blend files"),
        ("a.stl", (0, True, False, False), "read hulls from .glb, .gltf, .obj, .fbx, not from .stl files"),
        ("a.obj", (0, False, True, False), "need .glb or .gltf, not .obj"),
    ],
)
def test_what_a_format_cannot_have_is_refused(tmp_path, name, extras, sentence):
    with pytest.raises(ExportError, match=sentence):
        check_extras(tmp_path / name, *extras)


# Apple


@pytest.mark.parametrize("kind", ["asset", "textured", "sown"])
def test_all_validators_of_usd_find_a_usdz_clean(request, tmp_path, kind):
    """The validators that `usdchecker` runs; a stage without metadata shows that they look."""
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom, UsdValidation

    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert "usdUtilsValidators:UsdzPackageValidator" in {one.GetMetadata().name for one in validators}
    context, bad = UsdValidation.ValidationContext(validators), Usd.Stage.CreateInMemory()
    UsdGeom.Mesh.Define(bad, "/mesh")
    assert {"MissingDefaultPrim", "MissingUpAxisMetadata"} <= {error.GetName() for error in context.Validate(bad)}
    made = garden() if kind == "sown" else request.getfixturevalue(kind)
    found = context.Validate(Usd.Stage.Open(str(made.export(tmp_path / "a.usdz"))))
    assert [error.GetMessage() for error in found] == []
