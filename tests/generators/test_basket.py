"""The basket: the effects of its parameters; tests/contracts/test_adapters.py compares it with Infinigen's own."""

from collections.abc import Iterator

import numpy as np
import pytest
from factories.basket import volume

from dipcg.generators import load_generator
from dipcg.mesh import Mesh
from dipcg.workers.pool import BuildPool

BASKET = load_generator("basket")
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(BASKET.missing), reason="Infinigen is not installed")]


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("basket") as pool:
        pool.warm()
        yield pool


@pytest.mark.parametrize("detail", ["full", "light"])
def test_a_sharp_basket_has_the_size_of_its_parameters_and_stands_on_the_floor(pool, detail: str):
    mesh = pool.build(basket_with(depth=0.2, width=0.5, height=0.3, has_holes=True), detail)
    np.testing.assert_allclose(mesh.bounds, [[-0.1, -0.25, 0], [0.1, 0.25, 0.3]], atol=1e-6)


@pytest.mark.parametrize("level", [0, 3])
def test_the_basket_is_open_at_the_top_alone(pool, level: int):
    thin, thick = (pool.build(basket_with(frame_sub_level=level, thickness=t)) for t in (0.002, 0.004))
    # The volume is that of walls and bottom alone.
    assert volume(thick) == pytest.approx(2 * volume(thin), rel=0.02)
    assert genus(thin) == 0


def test_every_gap_is_a_hole(pool):
    """A height of 0.4 m minus the edges has 10 rows of holes at a distance of 30 mm; 0.2 and 0.3 m have 3 and 7."""
    size = {"depth": 0.2, "width": 0.3, "height": 0.4}
    holes = {"has_holes": True, "hole_size": 0.02, "hole_gap_size": 0.5, "hole_edge_gap": 0.09}
    assert genus(pool.build(basket_with(**size, **holes))) == 2 * 10 * (3 + 7)
    assert genus(pool.build(basket_with(**size, **holes | {"hole_gap_size": 2.0}))) == 2 * 5 * (1 + 3)
    assert genus(pool.build(basket_with(**size, **holes, has_handle=True, handle_dist_to_top=0.08))) > 0


def test_handles_make_two_openings(pool):
    assert genus(pool.build(basket_with(has_handle=True, handle_sub_level=2))) == 2


def test_low_baskets_have_holes(pool):
    low = basket_with(height=0.08, has_holes=True, hole_edge_gap=0.04, hole_size=0.01, hole_gap_size=1.0)
    assert genus(pool.build(low)) > 0


def genus(mesh: Mesh) -> int:
    """The number of holes through a closed surface, by Euler's formula."""
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all(), "it is not closed"
    return 1 - (len(np.unique(mesh.faces)) - len(edges) // 2 + len(mesh.faces)) // 2


def basket_with(**changes: object) -> dict:
    plain = {"frame_sub_level": 0, "has_handle": False, "has_holes": False}
    return BASKET.space.replace(BASKET.space.decode(np.zeros(len(BASKET.space))), plain | changes)
