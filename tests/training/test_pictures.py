"""Training pictures: a flipped one has the camera and the parameters that it shows, or is not made."""

from dataclasses import replace

import numpy as np
import pytest

from dipcg.camera import VIEW_NUMBERS, View, decode_view
from dipcg.config import AugmentConfig
from dipcg.data.shapes import Shapes
from dipcg.generators import load_generator
from dipcg.training.pictures import Picture, Pictures

BOX = load_generator("box")
X = np.linspace(-0.8, 0.8, len(BOX.space)).astype(np.float32)


def shown(mirrors: dict[str, str] | None, flip: float) -> tuple[np.ndarray, float]:
    """What a picture from 30° to the right is said to show: parameters and azimuth."""
    shapes = Shapes([], X[None], np.ones((1, len(X)), bool))
    pictures = Pictures(replace(BOX, mirrors=mirrors), shapes, 32, 1, config=AugmentConfig(flip=flip))
    image = np.zeros((32, 32, 4), np.uint8)
    _, x, _ = pictures._augment(Picture(0, View(30.0, 20.0), False, image), np.random.default_rng(0))
    return x[:-VIEW_NUMBERS], decode_view(x[-VIEW_NUMBERS:]).azimuth_deg


def test_a_flipped_picture_has_the_mirrored_camera_and_parameters():
    x, azimuth = shown({"width": "-width", "depth": "height", "height": "depth"}, flip=1.0)
    assert azimuth == pytest.approx(-30)
    np.testing.assert_allclose(x, [-X[0], X[2], X[1], *X[3:]])


@pytest.mark.parametrize(("mirrors", "flip"), [(None, 1.0), ({}, 0.0)])
def test_what_has_no_mirror_image_is_never_flipped(mirrors, flip):
    x, azimuth = shown(mirrors, flip)
    assert azimuth == pytest.approx(30)
    np.testing.assert_array_equal(x, X)
