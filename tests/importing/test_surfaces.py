"""How far a surface moved: nothing for rounding and for another order, something for every change of shape."""

import numpy as np
import pytest
import trimesh

from dipcg.importing.surfaces import moved
from dipcg.mesh import Mesh, make_mesh


@pytest.fixture
def ball() -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=3)
    return make_mesh(made.vertices, made.faces)


def test_the_same_surface_with_vertices_in_another_order_has_not_moved(ball):
    order = np.random.default_rng(0).permutation(len(ball.vertices))
    place = np.argsort(order).astype(np.int32)
    again = make_mesh(ball.vertices[order] + 1e-7, place[ball.faces])
    assert moved(ball, again) == 0


def test_a_missing_face_and_a_moved_vertex_are_seen(ball):
    assert moved(ball, make_mesh(ball.vertices, ball.faces[:-1])) > 0
    bent = ball.vertices.copy()
    bent[0] *= 1.1
    assert moved(ball, make_mesh(bent, ball.faces)) > 0


@pytest.mark.parametrize("shift", [0.01, 0.1])
def test_the_distance_is_a_share_of_the_side(ball, shift):
    larger = make_mesh(ball.vertices * (1 + 2 * shift), ball.faces)
    assert moved(ball, larger) == pytest.approx(2 * shift, rel=0.1)
