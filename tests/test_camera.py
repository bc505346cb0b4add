"""The camera convention against a look-at written by other means, and the framing of pictures."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dipcg.camera import View, ViewRange, camera_position, depth_range, fit, perspective, world_to_camera

VIEWS = st.builds(View, st.floats(-180, 180), st.floats(-80, 80), st.floats(1.2, 6))
CENTRES = st.tuples(*[st.floats(-5, 5)] * 3).map(np.array)
SIDES = st.floats(0.1, 10)
ORIGIN = np.zeros(3)


def cloud(centre: np.ndarray, side: float, seed: int = 0) -> np.ndarray:
    """Points whose bounding box has the given centre and longest side."""
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (200, 3)) * [0.7, 0.9, 1.0]
    points -= (points.min(0) + points.max(0)) / 2
    return points / np.ptp(points, axis=0).max() * side + centre


def project(points: np.ndarray, *matrices: np.ndarray) -> np.ndarray:
    """OpenGL's normalised coordinates of the points: x right, y up, in [-1, 1] inside the picture."""
    seen = np.concatenate([points, np.ones((len(points), 1))], axis=1).T
    for matrix in matrices:
        seen = matrix @ seen
    return (seen[:3] / seen[3]).T


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """gluLookAt with +Z up, from the eye and the target alone."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = [right, np.cross(right, forward), -forward]
    return matrix @ np.block([[np.eye(3), -eye[:, None]], [np.zeros((1, 3)), 1]])


@pytest.mark.parametrize(
    ("azimuth", "elevation", "stands_at"),
    [(0.0, 0.0, (0, -2, 0)), (90.0, 0.0, (2, 0, 0)), (180.0, 0.0, (0, 2, 0)), (-90.0, 0.0, (-2, 0, 0)),
     (0.0, 90.0, (0, 0, 2)), (0.0, 30.0, (0, -np.sqrt(3), 1)), (45.0, 0.0, (np.sqrt(2), -np.sqrt(2), 0))],
)  # fmt: skip
def test_azimuth_0_stands_in_front_and_90_at_plus_x(azimuth, elevation, stands_at):
    position = camera_position(View(azimuth, elevation, distance=4.0), ORIGIN, side=0.5)
    np.testing.assert_allclose(position, stands_at, atol=1e-12)


@given(VIEWS, CENTRES, SIDES)
def test_distance_is_in_longest_sides_from_the_centre(view, centre, side):
    away = np.linalg.norm(camera_position(view, centre, side) - centre)
    assert away == pytest.approx(view.distance * side, rel=1e-9)


@given(VIEWS, CENTRES, SIDES)
def test_the_view_matrix_is_that_of_a_look_at(view, centre, side):
    expected = look_at(camera_position(view, centre, side), centre)
    np.testing.assert_allclose(world_to_camera(view, centre, side), expected, atol=1e-7)


@given(VIEWS, CENTRES, SIDES)
def test_the_view_matrix_is_a_rotation_and_a_shift(view, centre, side):
    matrix = world_to_camera(view, centre, side)
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
    np.testing.assert_array_equal(matrix[3], [0, 0, 0, 1])


def test_looking_straight_down_keeps_an_upright_picture():
    matrix = world_to_camera(View(0.0, 90.0), ORIGIN, 1.0)
    np.testing.assert_allclose(matrix[:3, :3] @ [1, 0, 0], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(matrix[:3, :3] @ [0, 1, 0], [0, 1, 0], atol=1e-12)


def test_from_the_front_plus_x_is_right_and_plus_z_is_up():
    matrices = world_to_camera(View(0.0, 0.0), ORIGIN, 1.0), perspective(35.0, 0.1, 10.0)
    centre, right, up, far = project(np.array([[0, 0, 0], [0.3, 0, 0], [0, 0, 0.3], [0, 0.3, 0]]), *matrices)
    np.testing.assert_allclose(centre[:2], 0, atol=1e-12)
    assert right[0] > 0.1
    assert up[1] > 0.1
    assert far[2] > centre[2], "depth grows away from the camera"


def test_perspective_shows_exactly_its_field_of_view():
    edge = np.tan(np.radians(35 / 2))
    ends = project(
        np.array([[edge, 0, -1.0], [0, -edge, -1.0], [0, 0, -0.5], [0, 0, -7.0]]), perspective(35.0, 0.5, 7.0)
    )
    np.testing.assert_allclose(ends[:2, :2], [[1, 0], [0, -1]], atol=1e-12)
    np.testing.assert_allclose(ends[2:, 2], [-1, 1], atol=1e-12)


@given(VIEWS, CENTRES, SIDES, st.floats(0, 0.3))
def test_fit_leaves_exactly_the_margin(view, centre, side, margin):
    points = cloud(centre, side)
    to_camera = world_to_camera(view, centre, side)
    picture = (project(points, to_camera, fit(points, to_camera, margin)) + 1) / 2
    low, high = picture.min(0), picture.max(0)
    assert (high - low)[:2].max() == pytest.approx(1 - 2 * margin, abs=1e-6), "the longer direction fills the picture"
    np.testing.assert_allclose((low + high)[:2] / 2, 0.5, atol=1e-6, err_msg="the object is centred")
    assert low[2] >= 0, "nothing is cut by the near plane"
    assert high[2] <= 1, "nor by the far one"


def test_fit_does_not_stretch():
    square = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], float)
    wide = np.concatenate([square, [[5, 0, 0], [-5, 0, 0]]])
    to_camera = world_to_camera(View(0.0, 0.0, distance=3.0), ORIGIN, 10.0)
    width, height = np.ptp(project(square, to_camera, fit(wide, to_camera)), axis=0)[:2]
    assert width == pytest.approx(height)


@given(st.integers(0, 2**32 - 1))
def test_views_are_drawn_within_their_range(seed):
    views = ViewRange((-60.0, 60.0), (5.0, 45.0), (1.5, 6.0))
    view = views.sample(np.random.default_rng(seed))
    assert -60 <= view.azimuth_deg <= 60
    assert 5 <= view.elevation_deg <= 45
    assert 1.5 <= view.distance <= 6
    assert view == views.sample(np.random.default_rng(seed))


def test_perspective_strength_is_drawn_uniformly():
    rng = np.random.default_rng(0)
    inverse = [1 / ViewRange(distance=(2.0, 4.0)).sample(rng).distance for _ in range(2000)]
    assert np.mean(inverse) == pytest.approx((1 / 2 + 1 / 4) / 2, abs=0.01)


def test_depth_range_holds_the_object_and_stays_in_front():
    near, far = depth_range(np.array([2.0, 3.0]))
    assert 0 < near < 2
    assert far > 3
    assert depth_range(np.array([1e-6, 1.0]))[0] > 0
