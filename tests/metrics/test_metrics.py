"""The metrics compared with closed forms and brute force."""

import itertools

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from dipcg.mesh import make_mesh
from dipcg.metrics import (
    chamfer,
    choice_accuracy,
    emd,
    fscore,
    load_metric,
    normalise,
    parameter_error,
    sample_surface,
    squared_chamfer,
    surface_points,
    wide_fscore,
)
from dipcg.registry import allow_code
from dipcg.space import Choice, ParameterSpace, Real

SPACE = ParameterSpace(
    Real("width", 0.0, 2.0),
    Real("height", 0.0, 1.0, when={"tall": (True,)}),
    Choice("tall", (False, True)),
    Choice("top", ("flat", "round", "none"), when={"tall": (True,)}),
)
TALL = {"width": 1.0, "height": 0.5, "tall": True, "top": "flat"}


def plane(z: float, n: int = 30) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, n), np.linspace(-0.5, 0.5, n))
    return np.stack([x.ravel(), y.ravel(), np.full(n * n, z)], axis=1)


def rod(axis: int, n: int = 1001) -> np.ndarray:
    points = np.zeros((n, 3))
    points[:, axis] = np.linspace(-0.5, 0.5, n)
    return points


def square(size: float, offset: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[0, 0, 0], [size, 0, 0], [size, size, 0], [0, size, 0]]) + np.array([offset, 0, 0])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def random_points(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (n, 3))


@pytest.mark.parametrize("gap", [0.001, 0.1, 0.3])
def test_parallel_planes_differ_by_their_gap(gap):
    a, b = plane(0.0), plane(gap)
    assert chamfer.measure(a, b) == pytest.approx(2 * gap)
    assert emd.measure(a, b) == pytest.approx(gap)
    assert squared_chamfer.measure(a, b) == pytest.approx(2 * (2 * gap) ** 2)


def test_concentric_spheres_differ_by_their_radii():
    direction = random_points(20_000, 0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    assert chamfer.measure(0.5 * direction, 0.4 * direction) == pytest.approx(0.2, rel=0.02)
    assert emd.measure(0.5 * direction, 0.4 * direction) == pytest.approx(0.1)


def test_chamfer_of_crossed_rods_is_half_a_side_and_below_the_worst_value():
    # The crossing is the nearest point of the other rod, so each direction has the mean of |t| over half a side.
    value = chamfer.measure(rod(0), rod(1))
    assert value == pytest.approx(0.5, abs=0.001)
    assert value < chamfer.worst
    assert emd.measure(rod(0), rod(1)) < emd.worst
    assert squared_chamfer.measure(rod(0), rod(1)) == pytest.approx(2 / 3, abs=0.002)


def test_chamfer_agrees_with_brute_force_on_sets_of_different_size():
    a, b = random_points(300, 1), random_points(200, 2)
    distance = cdist(a, b)
    assert chamfer.measure(a, b) == pytest.approx(distance.min(1).mean() + distance.min(0).mean())
    expected = 4 * ((distance.min(1) ** 2).mean() + (distance.min(0) ** 2).mean())
    assert squared_chamfer.measure(a, b) == pytest.approx(expected)


def test_emd_is_the_minimum_over_all_matchings():
    a, b = random_points(6, 3), random_points(6, 4)
    matchings = itertools.permutations(range(6))
    assert emd.measure(a, b) == pytest.approx(min(np.linalg.norm(a - b[list(m)], axis=1).mean() for m in matchings))


def test_emd_prices_do_not_change_the_optimum():
    from scipy.optimize import linear_sum_assignment

    # Two boxes, and two plates at a right angle, where prices matter most.
    for thickness in (1.0, 0.01):
        a, b = random_points(250, 5) * [1, 1, thickness], random_points(250, 6) * [1, thickness, 1]
        distance = cdist(a, b)
        assert emd.measure(a, b) == pytest.approx(distance[linear_sum_assignment(distance)].mean(), abs=1e-12)


def test_emd_of_points_on_a_line_is_the_mean_difference_of_sorted_coordinates():
    a, b = np.zeros((500, 3)), np.zeros((500, 3))
    a[:, 0], b[:, 0] = random_points(500, 7)[:, 0], random_points(500, 8)[:, 0] ** 3
    assert emd.measure(a, b) == pytest.approx(np.abs(np.sort(a[:, 0]) - np.sort(b[:, 0])).mean())


def test_emd_depends_on_density_and_chamfer_does_not():
    dense_left = np.concatenate([plane(0.0), np.repeat(plane(0.0)[:1], 900, axis=0)])
    dense_right = np.concatenate([plane(0.0), np.repeat(plane(0.0)[-1:], 900, axis=0)])
    assert chamfer.measure(dense_left, dense_right) == 0
    assert emd.measure(dense_left, dense_right) == pytest.approx(np.sqrt(2) / 2, abs=1e-9)


def test_fscore_counts_points_closer_than_the_threshold():
    a, b = plane(0.0), plane(0.015)
    assert fscore.measure(a, b) == pytest.approx(1)
    assert fscore.measure(a, b, threshold=0.01) == 0
    # The precision is one half and the recall is one.
    both = np.concatenate([a, plane(10.0)])
    assert fscore.measure(both, b) == pytest.approx(2 / 3)


def test_fscore_variants_have_other_thresholds():
    a, b = plane(0.0), plane(0.03)
    columns = {column.name: column.measure(a, b) for column in load_metric("fscore").columns}
    assert columns == pytest.approx({"fscore": 0, "fscore@0.01": 0, "fscore@0.05": 1})


def test_wide_fscore_has_its_threshold_in_half_sides():
    assert wide_fscore.measure(plane(0.0), plane(0.049)) == pytest.approx(1)
    assert wide_fscore.measure(plane(0.0), plane(0.051)) == 0
    assert wide_fscore.measure_at_0_2(plane(0.0), plane(0.099)) == pytest.approx(1)


def test_the_best_quarter_turn_undoes_a_quarter_turn():
    shape = random_points(500, 9) * [1, 0.5, 0.2] + [0.1, 0.2, 0]
    for turns in range(4):
        turned = chamfer.quarter_turn(shape, turns)
        np.testing.assert_array_equal(chamfer.best_quarter_turn(turned, shape), shape)


def test_a_quarter_turn_maps_x_to_y():
    np.testing.assert_array_equal(chamfer.quarter_turn(np.array([[1.0, 0.0, 5.0]]), 1), [[0, 1, 5]])


def test_surface_points_are_distributed_by_area():
    (v1, f1), (v2, f2) = square(1.0), square(2.0, offset=10.0)
    points = sample_surface(make_mesh(np.concatenate([v1, v2]), np.concatenate([f1, f2 + 4])), 20_000, _rng())
    assert (points[:, 0] > 5).mean() == pytest.approx(4 / 5, abs=0.01)


def test_surface_points_are_uniform_over_a_triangle():
    points = sample_surface(make_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), 50_000, _rng())
    x, y, z = points.T
    assert (x >= 0).all()
    assert (y >= 0).all()
    assert (x + y <= 1 + 1e-9).all()
    assert (z == 0).all()
    # A quarter of the triangle lies beyond x = 1/2, and the centroid is at 1/3 on both axes.
    assert (x > 0.5).mean() == pytest.approx(0.25, abs=0.01)
    np.testing.assert_allclose(points.mean(0), [1 / 3, 1 / 3, 0], atol=0.01)


def test_surface_points_depend_on_the_seed():
    mesh = make_mesh(*square(1.0))
    np.testing.assert_array_equal(sample_surface(mesh, 50, _rng()), sample_surface(mesh, 50, _rng()))
    assert not np.array_equal(sample_surface(mesh, 50, _rng()), sample_surface(mesh, 50, _rng(1)))


def test_normalised_shapes_do_not_depend_on_position_and_size():
    vertices, faces = square(1.0)
    a = surface_points(make_mesh(vertices, faces), 100, _rng())
    b = surface_points(make_mesh(vertices * 3 + [5, -2, 7], faces), 100, _rng())
    np.testing.assert_allclose(a, b, atol=1e-6)
    points = normalise(random_points(100, 1) * [4, 2, 1] + 9)
    np.testing.assert_allclose(points.min(0) + points.max(0), 0, atol=1e-12)
    assert np.ptp(points, axis=0).max() == pytest.approx(1)


def test_vertices_without_a_face_are_ignored():
    vertices, faces = square(1.0)
    stray = make_mesh(np.concatenate([vertices, [[100, 100, 100]]]), faces)
    np.testing.assert_allclose(normalise(stray).vertices[:4], normalise(make_mesh(vertices, faces)).vertices, atol=1e-6)


def test_shapes_without_extent_are_refused():
    with pytest.raises(ValueError, match="extent"):
        normalise(np.ones((5, 3)))
    with pytest.raises(ValueError, match="area"):
        sample_surface(make_mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]), 10, _rng())


def test_parameter_error_is_the_mean_over_active_reals():
    # The errors in x are 1 and 0.5.
    estimate = TALL | {"width": 2.0, "height": 0.75}
    assert parameter_error.measure(SPACE, TALL, estimate) == pytest.approx(0.75)
    assert parameter_error.measure(SPACE, TALL, TALL) == 0
    short = SPACE.canonical(TALL | {"tall": False})
    assert parameter_error.measure(SPACE, short, short | {"width": 2.0, "height": 1.0}) == pytest.approx(1.0)


def test_choice_accuracy_is_the_share_of_active_choices():
    assert choice_accuracy.measure(SPACE, TALL, TALL | {"top": "none", "width": 0.0}) == pytest.approx(0.5)
    short = SPACE.canonical(TALL | {"tall": False})
    assert choice_accuracy.measure(SPACE, short, short | {"top": "none"}) == 1


def test_per_parameter_errors_cover_the_parameters_that_are_active_in_the_truth():
    errors = parameter_error.per_parameter(SPACE, TALL, TALL | {"width": 0.0, "top": "round"})
    assert errors == pytest.approx({"width": 1.0, "height": 0.0, "tall": 0.0, "top": 1.0})
    short = SPACE.canonical(TALL | {"tall": False})
    assert list(parameter_error.per_parameter(SPACE, short, TALL)) == ["width", "tall"]


def test_a_space_without_choices_or_reals_has_nan_and_not_a_good_value():
    assert np.isnan(choice_accuracy.measure(ParameterSpace(Real("a", 0.0, 1.0)), {"a": 0.5}, {"a": 0.5}))
    assert np.isnan(parameter_error.measure(ParameterSpace(Choice("a", (1, 2))), {"a": 1}, {"a": 1}))


def test_a_metric_file_without_a_declaration_is_refused(tmp_path):
    (tmp_path / "bare.py").write_text("unit = 'm'\n")
    allow_code(tmp_path / "bare.py")
    with pytest.raises(ValueError, match="must define measure, better, worst"):
        load_metric(str(tmp_path / "bare.py"))
    with pytest.raises(LookupError, match="Did you mean 'chamfer'"):
        load_metric("chamfre")


def _rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)
