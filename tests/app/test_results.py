"""Results as the API gives them: the colours that the picture shows on the parts of a candidate."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from boxes import TRUTH, VIEW, among, untrained

from dipcg.app.results import _colours
from dipcg.pipeline import Candidate
from dipcg.render import Look, Renderer

COLOURS = np.array([[0.8, 0.2, 0.2], [0.2, 0.7, 0.3], [0.2, 0.3, 0.9]])


@pytest.fixture(scope="module")
def photographed():
    """A box with flat colours, its picture and an estimate of it."""
    inverter, renderer = untrained("box"), Renderer(256)
    mesh = inverter.generator.build(TRUTH)
    picture = renderer.render(mesh, VIEW, Look(COLOURS, strengths=np.zeros(2), ambient=1.0))
    renderer.close()
    return mesh, among(inverter, np.ascontiguousarray(picture), TRUTH)


def test_each_part_has_the_colour_that_the_picture_shows(photographed) -> None:
    mesh, estimate = photographed
    found = _colours(estimate, Candidate(TRUTH, VIEW, mesh=mesh))
    assert set(found) == set(mesh.part_names)
    for name, colour in zip(mesh.part_names, COLOURS, strict=False):
        np.testing.assert_allclose(found[name], colour, atol=0.03)


def test_a_line_drawing_has_no_colours(photographed) -> None:
    mesh, estimate = photographed
    alpha = estimate.image[..., 3]
    lines = alpha - cv2.erode(alpha, np.ones((5, 5), np.uint8))
    drawing = np.dstack([estimate.image[..., :3], lines])
    assert _colours(replace(estimate, image=drawing), Candidate(TRUTH, VIEW, mesh=mesh)) == {}
