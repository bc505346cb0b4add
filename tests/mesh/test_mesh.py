"""Meshes: checked building, polygons to triangles, simplification that keeps parts and stays close."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from dipcg.mesh import Mesh, join, make_mesh, triangulate
from dipcg.mesh.simplify import compact, simplify

CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
TWO = [[0, 1, 2], [0, 2, 3]]


def as_trimesh(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def ball(level: int = 4, radius: float = 1.0, centre: tuple = (0, 0, 0)) -> tuple[np.ndarray, np.ndarray]:
    shape = trimesh.creation.icosphere(level, radius)
    return shape.vertices + np.array(centre), shape.faces


def polygon(corners: int, radius: float, centre: float) -> np.ndarray:
    angles = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    return np.stack([centre + radius * np.cos(angles), radius * np.sin(angles), np.full(corners, centre)], axis=1)


@given(st.lists(st.tuples(st.integers(3, 9), st.floats(0.5, 2)), min_size=1, max_size=8))
def test_triangles_cover_each_polygon_exactly(shapes):
    vertices = np.concatenate([polygon(n, radius, float(i)) for i, (n, radius) in enumerate(shapes)])
    sizes = np.array([n for n, _ in shapes])
    faces, source = triangulate(sizes, np.arange(sizes.sum()))
    areas = np.bincount(source, trimesh.triangles.area(vertices[faces]))
    # The area of a regular polygon.
    expected = [n / 2 * r**2 * np.sin(2 * np.pi / n) for n, r in shapes]
    np.testing.assert_allclose(areas, expected)
    np.testing.assert_array_equal(np.bincount(source), sizes - 2)


def test_triangles_keep_the_polygons_winding():
    vertices = polygon(6, 1.0, 0.0)
    faces, _ = triangulate(np.array([6]), np.arange(6))
    normals, _ = trimesh.triangles.normals(vertices[faces])
    np.testing.assert_allclose(normals, [[0, 0, 1]] * 4, atol=1e-12)


def test_a_box_of_quads_has_the_volume_of_the_box():
    box = trimesh.creation.box((1, 2, 3))
    quads = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    corners = np.array([[x, y, z] for z in (0, 3) for y in (0, 2) for x in (0, 1)], float)
    faces, _ = triangulate(np.full(6, 4), quads.ravel())
    made = trimesh.Trimesh(corners, faces)
    assert made.volume == pytest.approx(box.volume)
    assert made.area == pytest.approx(box.area)


def test_mixed_triangles_and_quads_index_their_own_corners():
    faces, source = triangulate(np.array([3, 4, 3]), np.array([0, 1, 2, 10, 11, 12, 13, 5, 6, 7]))
    assert faces.tolist() == [[0, 1, 2], [10, 11, 12], [10, 12, 13], [5, 6, 7]]
    assert source.tolist() == [0, 1, 1, 2]


@pytest.mark.parametrize(
    ("vertices", "faces", "parts", "sentence"),
    [
        ([], [], None, "it has 0 vertices and 0 faces"),
        (CORNERS, [], None, "it has 4 vertices and 0 faces"),
        ([*CORNERS[:3], [0, np.nan, 0]], TWO, None, "1 of its 4 vertices are not finite"),
        ([*CORNERS[:3], [0, np.inf, 0]], TWO, None, "1 of its 4 vertices are not finite"),
        (CORNERS, [[0, 1, 4]], None, "a face names vertex 4 of 4"),
        (CORNERS, [[0, 1, -1]], None, "a face names vertex -1 of 4"),
        (CORNERS, TWO, [0], "its parts do not name one of 1 parts for each of 2 faces"),
        (CORNERS, TWO, [0, 1], "its parts do not name one of 1 parts for each of 2 faces"),
        (CORNERS, [[0, 1, 2, 3]] * 3, None, "its faces have the shape (3, 4), not (f, 3)"),
        (np.zeros((6, 2)), TWO, None, "its vertices have the shape (6, 2), not (v, 3)"),
    ],
)
def test_an_unusable_mesh_gets_a_sentence(vertices, faces, parts, sentence):
    with pytest.raises(ValueError) as error:
        make_mesh(vertices, faces, parts)
    assert str(error.value) == f"The generator built no usable mesh: {sentence}."


def test_flat_buffers_are_read_in_threes():
    mesh = make_mesh(np.ravel(CORNERS), np.ravel(TWO))
    np.testing.assert_array_equal(mesh.vertices, CORNERS)
    np.testing.assert_array_equal(mesh.faces, TWO)
    np.testing.assert_array_equal(mesh.parts, [0, 0])


def test_bounds_centre_and_side():
    mesh = make_mesh([[0, 0, 0], [2, 0, 1], [2, 4, 0]], [[0, 1, 2]])
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [2, 4, 1]])
    np.testing.assert_array_equal(mesh.centre, [1, 2, 0.5])
    assert mesh.side == 4


def test_joined_pieces_of_the_same_name_share_a_part():
    mesh = join([("leg", *ball(1)), ("seat", *ball(2, centre=(3, 0, 0))), ("leg", *ball(1, centre=(6, 0, 0)))])
    assert mesh.part_names == ("leg", "seat")
    assert np.bincount(mesh.parts).tolist() == [2 * 80, 320]
    seat = mesh.vertices[mesh.faces[mesh.parts == 1]]
    np.testing.assert_allclose([seat[..., 0].min(), seat[..., 0].max()], [2, 4], atol=0.01)


def test_compacting_drops_unused_vertices_and_keeps_the_surface():
    mesh = make_mesh([[9, 9, 9], *CORNERS], [[1, 2, 3], [1, 3, 4]], [1, 0], ("a", "b"))
    packed = compact(mesh)
    assert packed.parts.tolist() == [0, 1]
    np.testing.assert_array_equal(packed.vertices[packed.faces], mesh.vertices[mesh.faces[[1, 0]]])
    assert len(packed.vertices) == 4


def test_simplified_surfaces_stay_within_the_error():
    # This ball has 20,480 faces.
    vertices, faces = ball(5)
    coarse = simplify(make_mesh(vertices, faces), faces=2000, error=0.004)
    assert len(coarse.faces) <= 2100
    points, _ = trimesh.sample.sample_surface(as_trimesh(coarse), 5000, seed=0)
    # The distance from the unit sphere.
    off = np.abs(np.linalg.norm(points, axis=1) - 1)
    assert off.max() < 2 * 0.004 * 2, "twice the error, of an extent of two"
    assert cKDTree(points).query(vertices)[0].max() < 0.15, "and nothing is missing"


def test_the_error_stops_simplification_before_the_target_does():
    mesh = make_mesh(*ball(5))
    fine, coarse = simplify(mesh, faces=10, error=0.0005), simplify(mesh, faces=10, error=0.02)
    assert len(fine.faces) > 3 * len(coarse.faces) > 3 * 10


def test_simplification_keeps_every_part_apart():
    pieces = [("leg", *ball(4)), ("seat", *ball(5, centre=(3, 0, 0)))]
    coarse = simplify(join(pieces), faces=3000)
    assert coarse.part_names == ("leg", "seat")
    for part, low in enumerate((-1, 2)):
        x = coarse.vertices[coarse.faces[coarse.parts == part]][..., 0]
        np.testing.assert_allclose([x.min(), x.max()], [low, low + 2], atol=0.02)


def test_small_meshes_are_left_alone():
    mesh = make_mesh(*ball(2))
    assert simplify(mesh, faces=320) is mesh


def test_a_mesh_simplifies_the_same_way_each_time():
    a, b = (simplify(make_mesh(*ball(4)), faces=500) for _ in range(2))
    np.testing.assert_array_equal(a.vertices, b.vertices)
    np.testing.assert_array_equal(a.faces, b.faces)
