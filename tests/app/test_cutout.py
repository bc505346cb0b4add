"""Correcting the cut-out: each way of cutting and the crop leave what they say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dipcg.app.cutout import MOST_CROPPED, SIDE, Correction, corrected, cropped, shown
from dipcg.images import ImageError

SHARES = st.floats(0, MOST_CROPPED / 2)


def squares() -> np.ndarray:
    """A grey square on white, and a darker one in its middle."""
    image = np.full((64, 64, 4), 255, np.uint8)
    image[16:48, 16:48, :3] = 120
    image[24:40, 24:40, :3] = 40
    return image


def test_each_way_of_cutting_leaves_what_it_says():
    image, mask = squares(), np.zeros((64, 64), np.uint8)
    mask[:32] = 255
    opaque = {
        "automatic": 32 * 32,
        "by colour": 16 * 16,  # what is far from white alone
        "own mask": 32 * 64,
        "nothing": 64 * 64,
    }
    for how, pixels in opaque.items():
        cut = corrected(image, Correction(how, 70.0, mask))
        found = shown(cut)[0][..., 3]
        share = pixels / max(np.ptp(np.nonzero(_alpha(cut, image)), axis=1) + 1) ** 2
        assert (found > 128).mean() == pytest.approx(share * (1 - 0.12) ** 2, rel=0.06), how


def _alpha(cut: np.ndarray, image: np.ndarray) -> np.ndarray:
    return cut[..., 3] > 128 if (cut[..., 3] < 128).any() else image[..., 0] < 200


@settings(max_examples=30)
@given(SHARES, SHARES, SHARES, SHARES)
def test_a_crop_is_a_piece_of_the_picture_as_large_as_the_shares_say(left, right, top, bottom):
    rows, columns = np.mgrid[:90, :120].astype(np.uint8)
    image = np.dstack([rows, columns, rows, np.full_like(rows, 255)])
    piece = cropped(image, (left, right, top, bottom))
    assert np.abs(np.subtract(piece.shape[:2], [90 * (1 - top - bottom), 120 * (1 - left - right)])).max() < 2
    assert list(piece[0, 0, :2]) == [int(90 * top), int(120 * left)]
    assert (np.diff(piece[:, 0, 0].astype(int)) == 1).all()
    assert (np.diff(piece[0, :, 1].astype(int)) == 1).all()


def test_a_crop_leaves_one_of_two_objects():
    two = np.hstack([squares(), squares()])
    for crop in [(0.5, 0.0, 0.0, 0.0), (0.0, 0.5, 0.0, 0.0)]:
        assert np.array_equal(shown(corrected(two, Correction(crop=crop)))[0], shown(squares())[0])


def test_a_mask_of_the_whole_picture_is_cropped_with_it():
    mask = np.zeros((64, 64), np.uint8)
    mask[:, :32] = 255
    cut = corrected(squares(), Correction("own mask", mask=mask, crop=(0.25, 0.25, 0.0, 0.0)))
    assert np.array_equal(cut[..., 3] > 0, np.tile(np.arange(32) < 16, (64, 1)))
    assert shown(cut)[0].shape == (SIDE, SIDE, 4)


@pytest.mark.parametrize("crop", [(0.5, 0.5, 0.0, 0.0), (0.0, 0.0, 0.9, 0.1), (-0.1, 0.0, 0.0, 0.0)])
def test_a_crop_that_leaves_nothing_is_refused_in_a_sentence(crop):
    with pytest.raises(ImageError, match="The crop leaves too little"):
        corrected(squares(), Correction(crop=crop))
