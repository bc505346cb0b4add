"""Corrections of the cut-out: where strokes, masks and crops lie."""

import numpy as np
import pytest

from dipcg.app.cutout import cut
from dipcg.app.models import Corrections, Crop, Stroke

WHITE, RED, BLUE = (250, 250, 250, 255), (200, 30, 30, 255), (30, 30, 200, 255)


@pytest.fixture
def two_squares() -> np.ndarray:
    """A red and a blue square on white, far from each other."""
    image = np.full((100, 200, 4), WHITE, np.uint8)
    image[30:70, 30:70], image[30:70, 130:170] = RED, BLUE
    return image


def shows(image: np.ndarray, colour: tuple[int, ...]) -> float:
    """The share of the pixels of a colour that are not cut away."""
    return float(np.mean(image[(image[..., :3] == colour[:3]).all(-1)][:, 3] > 127))


@pytest.mark.parametrize("crop", [Crop(), Crop(top=0.1, left=0.1), Crop(bottom=0.2, right=0.1)])
def test_a_stroke_lies_on_all_of_the_picture_however_it_is_cropped(two_squares: np.ndarray, crop: Crop) -> None:
    beside = Stroke(points=[(0.7, 0.4), (0.8, 0.6)], radius=0.08)
    found = cut(two_squares, Corrections(crop=crop, background=[beside])).image
    assert shows(found, RED) > 0.9
    assert shows(found, BLUE) < 0.1


def test_a_mask_of_another_size_lies_on_all_of_the_picture(two_squares: np.ndarray) -> None:
    mask = np.zeros((50, 50, 4), np.uint8)
    mask[..., 3] = 255
    mask[:, :25, :3] = 255
    found = cut(two_squares, Corrections(how="mask", crop=Crop(left=0.1)), mask).image
    assert shows(found, RED) == 1
    assert shows(found, BLUE) == 0


def test_a_picture_that_is_taken_as_it_is_keeps_its_ground(two_squares: np.ndarray) -> None:
    assert shows(cut(two_squares, Corrections(how="as it is")).image, WHITE) == 1
