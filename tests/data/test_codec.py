"""Packed meshes: the same shape in a few kilobytes."""

import numpy as np
import pytest
import trimesh

from dipcg.data.codec import decode_mesh, encode_mesh
from dipcg.generators import load_generator
from dipcg.mesh import Mesh, make_mesh
from dipcg.workers.pool import BuildPool


def shapes() -> dict[str, Mesh]:
    ball = trimesh.creation.icosphere(subdivisions=3)
    parts = (ball.triangles_center[:, 2] > 0) + 2 * (ball.triangles_center[:, 0] > 0.5)
    rng = np.random.default_rng(0)
    return {
        "triangle": make_mesh([[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 1, 2]]),
        "parts out of order": make_mesh(
            ball.vertices * [3, 1, 0.2] - 100, ball.faces, parts, ("a", "b", "c", "Rücken")
        ),
        "a part without faces": make_mesh(ball.vertices, ball.faces, parts * 0 + 1, ("a", "b", "c")),
        "soup": make_mesh(rng.normal(size=(300, 3)), rng.permutation(300).reshape(-1, 3)),
    }


@pytest.mark.parametrize("mesh", shapes().values(), ids=shapes())
def test_a_packed_mesh_is_the_same_within_a_4096th_of_its_side(mesh):
    again = decode_mesh(encode_mesh(mesh))
    order = np.argsort(mesh.parts, kind="stable")
    before, after = mesh.vertices[mesh.faces[order]], again.vertices[again.faces]
    turns = [np.abs(np.roll(after, turn, axis=1) - before).max((1, 2)) for turn in range(3)]
    assert np.min(turns, axis=0).max() < mesh.side / 2**12 + 1e-5, "each triangle is there, with its side outwards"
    np.testing.assert_array_equal(again.parts, mesh.parts[order])
    assert again.part_names == mesh.part_names


def test_a_packed_mesh_is_small():
    ball = trimesh.creation.icosphere(subdivisions=4)
    mesh = make_mesh(ball.vertices, ball.faces)
    assert len(encode_mesh(mesh)) < (mesh.vertices.nbytes + mesh.faces.nbytes) / 6


@pytest.mark.blender
def test_chairs_take_at_most_16_kilobytes_each():
    chair = load_generator("chair")
    if chair.missing:
        pytest.skip(f"{' and '.join(chair.missing)} not installed")
    rng = np.random.default_rng(0)
    with BuildPool("chair", workers=2) as pool:
        built = pool.map([chair.space.sample(rng) for _ in range(10)], "light")
        assert np.mean([len(encode_mesh(mesh)) for mesh in built]) <= 16_000
