"""The chair: the effects of its parameters; tests/contracts/test_adapters.py compares it with Infinigen's own."""

from collections.abc import Iterator

import numpy as np
import pytest

from dipcg.generators import load_generator
from dipcg.workers.pool import BuildPool

CHAIR = load_generator("chair")
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(CHAIR.missing), reason="Infinigen is not installed")]


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("chair") as pool:
        pool.warm()
        yield pool


def test_the_chair_has_the_height_and_the_width_of_its_parameters(pool):
    params = chair_with(leg_height=0.5, back_height=0.4, width=0.6, leg_type="vertical", back_type="whole")
    mesh = pool.build(params, "light")
    assert mesh.bounds[0, 2] == pytest.approx(-0.5, abs=0.002)
    assert 0.4 < mesh.bounds[1, 2] < 0.45, "the top of a whole back is arched"
    assert np.ptp(mesh.bounds[:, 0]) == pytest.approx(0.6, abs=0.03)


@pytest.mark.parametrize("switch", ["has_arm", "has_leg_x_bar", "has_leg_y_bar"])
def test_switches_add_a_part_on_both_sides(pool, switch):
    part = "arm" if switch == "has_arm" else "bar"
    without, with_it = (pool.build(chair_with(**{switch: on}), "light") for on in (False, True))
    assert part not in without.part_names
    added = with_it.vertices[np.unique(with_it.faces[with_it.parts == with_it.part_names.index(part)])]
    axis = 1 if switch == "has_leg_x_bar" else 0
    offsets = added[:, axis] - with_it.centre[axis]
    assert offsets.min() < -0.05
    assert offsets.max() > 0.05


def chair_with(**changes: object) -> dict:
    plain = {"has_arm": False, "has_leg_x_bar": False, "has_leg_y_bar": False}
    return CHAIR.space.replace(CHAIR.space.decode(np.zeros(len(CHAIR.space))), plain | changes)


def _ratio(spans: list) -> float:
    """The gap below a slat as a share of slat and gap, from the second slat, whose gap begins where the first ends."""
    return (spans[1][0] - spans[0][1]) / (spans[1][1] - spans[0][1])
