"""Colours of a picture on the parts of an asset: a picture of known colours gives them back."""

import numpy as np
import pytest
from boxes import TRUTH, VIEW

from dipcg.app.colours import part_colours
from dipcg.generators import load_generator
from dipcg.render import Look, Renderer

COLOURS = np.array([[0.8, 0.2, 0.2], [0.2, 0.7, 0.3], [0.2, 0.3, 0.9]])
FLAT = Look(COLOURS, strengths=np.zeros(2), ambient=1.0)


@pytest.fixture(scope="module")
def renderer():
    renderer = Renderer(256)
    yield renderer
    renderer.close()


@pytest.fixture(scope="module")
def box():
    return load_generator("box").build(TRUTH)


def test_each_part_has_the_colour_that_the_picture_shows(renderer, box) -> None:
    picture = renderer.render(box, VIEW, FLAT)
    found = part_colours(picture, box, VIEW, renderer)
    assert set(found) == set(box.part_names)
    for name, colour in zip(box.part_names, COLOURS, strict=False):
        np.testing.assert_allclose(found[name], colour, atol=0.01)


def test_shade_and_a_highlight_change_a_colour_little(renderer, box) -> None:
    picture = renderer.render(box, VIEW, FLAT).copy()
    picture[120:128, 120:128, :3] = 255
    found = part_colours(picture, box, VIEW, renderer)
    for name, colour in zip(box.part_names, COLOURS, strict=False):
        np.testing.assert_allclose(found[name], colour, atol=0.05)


def test_a_line_drawing_has_no_colours(renderer, box) -> None:
    picture = renderer.render(box, VIEW, FLAT).copy()
    inside = picture[..., 3] > 0
    edge = inside & ~(np.roll(inside, 2, 0) & np.roll(inside, -2, 0) & np.roll(inside, 2, 1) & np.roll(inside, -2, 1))
    picture[~edge] = 0
    assert part_colours(picture, box, VIEW, renderer) == {}
