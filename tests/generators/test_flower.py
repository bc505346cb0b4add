"""The flower: the effects of its parameters; tests/contracts/test_adapters.py compares it with Infinigen's own."""

from collections.abc import Iterator

import numpy as np
import pytest

from dipcg.generators import load_generator
from dipcg.mesh import Mesh
from dipcg.metrics import chamfer, surface_points
from dipcg.workers.pool import BuildPool

FLOWER = load_generator("flower")
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(FLOWER.missing), reason="Infinigen is not installed")]


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("flower") as pool:
        pool.warm()
        yield pool


def distance(a: Mesh, b: Mesh) -> float:
    """The chamfer distance of the surfaces, minus that of two samples of the same surface."""
    points = [surface_points(mesh, 8000, np.random.default_rng(i)) for i, mesh in enumerate((a, b, a))]
    return chamfer.measure(points[0], points[1]) - chamfer.measure(points[0], points[2])


@pytest.mark.parametrize("base_width", [4.5, 9.0, 15.5])
def test_a_flower_has_a_fifth_more_petals_than_fit_side_by_side(pool, base_width: float):
    mesh = pool.build(flower_with(base_width=base_width))
    faces = (mesh.parts == mesh.part_names.index("petal")).sum()
    assert faces / (15 * 16 * 2) == int(1.2 * base_width)


def test_exchanged_angles_give_the_mirror_image(pool):
    one, other = (pool.build(flower_with(min_angle=a, max_angle=b)) for a, b in ((0.0, 70.0), (70.0, 0.0)))
    np.testing.assert_array_equal(other.vertices, one.vertices * [-1, 1, 1])


def test_the_centre_has_its_share_of_the_radius(pool):
    mesh = pool.build(flower_with(overall_rad=1.0, pct_inner=0.4, seed_size=0.005))
    centre = mesh.vertices[np.unique(mesh.faces[mesh.parts == mesh.part_names.index("centre")])]
    assert np.hypot(centre[:, 0], centre[:, 1]).max() == pytest.approx(0.4, abs=0.01)


def test_light_seeds_are_as_high_and_far_fewer(pool):
    params = flower_with(overall_rad=1.3, pct_inner=0.5, seed_size=0.005)
    full, light = pool.build(params), pool.build(params, "light")
    assert len(light.faces) < 0.05 * len(full.faces)
    assert distance(full, light) < 0.01


def flower_with(**changes: object) -> dict:
    return FLOWER.space.replace(FLOWER.space.decode(np.zeros(len(FLOWER.space))), changes)
