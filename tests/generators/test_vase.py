"""The vase: the effects of its parameters; tests/contracts/test_adapters.py compares it with Infinigen's own."""

from collections.abc import Iterator

import numpy as np
import pytest

from dipcg.generators import load_generator
from dipcg.workers.pool import BuildPool

VASE = load_generator("vase")
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(VASE.missing), reason="Infinigen is not installed")]


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("vase") as pool:
        pool.warm()
        yield pool


@pytest.mark.parametrize("detail", ["full", "light"])
@pytest.mark.parametrize("height", [0.2, 0.5, 0.8])
def test_the_vase_has_the_height_and_the_width_of_its_parameters(pool, height: float, detail: str):
    params = vase_with(dimension_z=height, dimension_x=0.4 * height, profile_inner_radius=1.0, neck_position=-0.1)
    low, high = pool.build(params, detail).bounds
    assert high[2] - low[2] == pytest.approx(height, rel=0.03)
    # The smooth outline bulges beyond the points that it is made from.
    assert high[0] - low[0] == pytest.approx(2 * params["dimension_x"], rel=0.08)


@pytest.mark.parametrize("points", [3, 4, 5])
def test_a_star_has_the_given_number_of_points(pool, points: int):
    vertices = pool.build(vase_with(profile_star_points=points, profile_inner_radius=0.8)).vertices
    angle, radius = np.arctan2(vertices[:, 1], vertices[:, 0]), np.hypot(vertices[:, 0], vertices[:, 1])
    widest = np.abs(vertices[:, 2] - vertices[radius.argmax(), 2]) < 0.01
    waves = [np.abs(np.sum(radius[widest] * np.exp(1j * corners * angle[widest]))) for corners in range(2, 8)]
    assert np.argmax(waves) + 2 == points


def vase_with(**changes: object) -> dict:
    return VASE.space.replace(VASE.space.decode(np.zeros(len(VASE.space))), changes)
