"""Meshes of other tools: reading, alignment that undoes any turn, topology of shapes that are known, the command."""

import io
import json
from contextlib import redirect_stdout

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from dipcg.cli import main
from dipcg.data.store import Store, build_dataset
from dipcg.evaluation.evaluate import split_cases
from dipcg.evaluation.external import align, axis_rotations, measure_meshes, read_mesh, write_pictures
from dipcg.evaluation.topology import quads_in, topology
from dipcg.export.asset import Asset
from dipcg.mesh import MeshError, make_mesh
from dipcg.metrics import normalise, surface_points
from dipcg.metrics.chamfer import measure as chamfer


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    build_dataset("box", folder, 60)
    return folder


@pytest.fixture(scope="module")
def shape(data):
    return next(s.mesh for s in Store(data).samples("train") if s.params["top"] == "pyramid" and s.params["has_legs"])


def test_the_24_rotations_are_all_and_proper():
    found = axis_rotations()
    assert len({tuple(matrix.ravel()) for matrix in found}) == 24
    for matrix in found:
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3))
        assert np.linalg.det(matrix) == pytest.approx(1)


@pytest.mark.parametrize("turn_deg", [(0, 0, 0), (90, 0, 180), (0, -90, 90), (8, -12, 95)])
def test_alignment_undoes_axes_size_place_and_a_tilt(shape, turn_deg):
    truth = surface_points(shape, 3000, np.random.default_rng(0))
    again = surface_points(shape, 3000, np.random.default_rng(1))
    turned = Rotation.from_euler("xyz", turn_deg, degrees=True).apply(again)
    aligned = align(normalise(3 * turned + 5), truth)
    assert chamfer(aligned, truth) < 1.15 * chamfer(again, truth) + 0.002
    assert chamfer(normalise(turned), truth) > chamfer(aligned, truth) - 1e-9


def test_topology_counts_the_edges_of_known_shapes():
    cube = trimesh.creation.box()
    whole = topology(make_mesh(cube.vertices, cube.faces))
    assert (whole.triangles, whole.open_edges, whole.non_manifold_edges, whole.watertight) == (12, 0, 0, True)
    loose = topology(make_mesh(cube.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3)))
    # Corners at one place are one vertex.
    assert loose == whole
    missing = topology(make_mesh(cube.vertices, cube.faces[1:]))
    assert (missing.open_edges, missing.watertight) == (3, False)
    fin = np.vstack([cube.vertices, cube.vertices[cube.edges[0]].mean(0) + 5])
    extra = topology(make_mesh(fin, np.vstack([cube.faces, [*cube.edges[0], 8]])))
    assert (extra.non_manifold_edges, extra.open_edges, extra.watertight) == (1, 2, False)


def test_quads_are_counted_where_a_format_has_them(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1 2 3 4\nf 1 2 5\nf 2 3 5\nf 3/1/1 4/1/1 5/1/1\n"
    (tmp_path / "a.obj").write_text(text)
    assert quads_in(tmp_path / "a.obj") == 0.25
    assert quads_in(tmp_path / "a.glb") is None


def test_glb_is_read_upright(shape, tmp_path):
    Asset(shape, "box", {}).export(tmp_path / "a.glb")
    found = read_mesh(tmp_path / "a.glb")
    # A file stands over the origin, which the shape only nearly does.
    np.testing.assert_allclose(np.ptp(found.bounds, axis=0), np.ptp(shape.bounds, axis=0), atol=1e-5)
    assert found.bounds[0, 2] == pytest.approx(0, abs=1e-5)


def test_a_file_without_a_mesh_is_told(tmp_path):
    (tmp_path / "a.obj").write_text("nothing")
    with pytest.raises(MeshError, match=r"a\.obj has no mesh that can be read"):
        read_mesh(tmp_path / "a.obj")


@pytest.mark.slow
def test_the_true_meshes_measure_like_the_noise_floor_and_a_missing_one_as_the_worst(data, tmp_path):
    cases = list(split_cases(data, 3))
    for case in cases[:2]:
        Asset(case.mesh, "box", {}).export(tmp_path / f"{case.name}.glb")
    table, shapes, quads = measure_meshes(cases, tmp_path, ["chamfer", "fscore"])
    values = table.values[tmp_path.name]
    assert max(values["chamfer"][:2]) < 0.03
    assert values["chamfer"][2] == 1.0
    assert values["fscore"][2] == 0.0
    assert table.failures[tmp_path.name] == 1
    assert set(shapes) == {cases[0].name, cases[1].name}
    assert quads == {}
    with pytest.raises(ValueError, match="no readable mesh named after a case"):
        measure_meshes(cases, tmp_path / "none", ["chamfer"])


@pytest.mark.slow
def test_the_command_writes_pictures_and_measures_what_was_made_of_them(data, tmp_path):
    words = ["evaluate", "box", "--data", str(data), "--count", "2"]
    main([*words, "--pictures", str(tmp_path / "pictures")])
    names = sorted(path.stem for path in (tmp_path / "pictures").glob("*.png"))
    assert names == ["test-0", "test-1"]
    (tmp_path / "tool").mkdir()
    for name, case in zip(names, split_cases(data, 2), strict=True):
        Asset(case.mesh, "box", {}).export(tmp_path / "tool" / f"{name}.obj")
    out = io.StringIO()
    with redirect_stdout(out):
        main([*words, "--meshes", str(tmp_path / "tool"), "--metric", "chamfer", "--json", str(tmp_path / "t.json")])
    assert "| tool | 2 | 0.0" in out.getvalue()
    assert "| 2 |" in out.getvalue().splitlines()[-1]
    found = json.loads((tmp_path / "t.json").read_text())
    assert found["accuracy"]["tool"]["chamfer"][0] < 0.03
    assert set(found["topology"]) == {"test-0", "test-1"}
    assert write_pictures(split_cases(data, 1), tmp_path / "more") == 1


def test_meshes_under_the_protocol_of_the_paper_get_its_columns(data, tmp_path, monkeypatch):
    cases = list(split_cases(data, 1))
    (tmp_path / "tool").mkdir()
    Asset(cases[0].mesh, "box", {}).export(tmp_path / "tool" / f"{cases[0].name}.glb")
    monkeypatch.setattr("dipcg.cli.evaluate._as_published", lambda data, count: iter(cases))
    out = io.StringIO()
    with redirect_stdout(out):
        main(["evaluate", "box", "--data", str(data), "--protocol", "paper", "--meshes", str(tmp_path / "tool")])
    assert {"chamfer", "emd", "fscore"} <= set(out.getvalue().splitlines()[0].split())
