"""Cutting: shadows, pale objects, several things and strokes, on pictures whose truth is known."""

import cv2
import numpy as np
import pytest

from dipcg.images import Cutout, ImageError, cut_out

SIZE = 192
Y, X = np.mgrid[:SIZE, :SIZE].astype(np.float32)


def disc(x: float = 96, y: float = 80, radius: float = 45) -> np.ndarray:
    return np.hypot(X - x, Y - y) < radius


def painted(ground: np.ndarray | tuple, *objects: tuple[np.ndarray, tuple]) -> np.ndarray:
    picture = np.empty((SIZE, SIZE, 3), np.float32)
    picture[:] = ground
    for mask, colour in objects:
        picture[mask] = colour
    return picture.clip(0, 255).astype(np.uint8)


def overlap(image: np.ndarray, truth: np.ndarray) -> float:
    found = image[..., 3] > 127
    return (found & truth).sum() / (found | truth).sum()


def shadowed(ground: np.ndarray) -> np.ndarray:
    """The ground with a soft shadow beside the foot of the disc."""
    spot = np.zeros((SIZE, SIZE), np.float32)
    cv2.ellipse(spot, (125, 122), (55, 14), 0, 0, 360, 1.0, -1)
    return ground * (1 - 0.45 * cv2.GaussianBlur(spot, (0, 0), 9))[..., None]


@pytest.mark.parametrize("ground", [(255, 255, 255), (200, 210, 225), (120, 160, 110)])
@pytest.mark.parametrize("colour", [(30, 90, 90), (170, 60, 40)])
def test_a_soft_shadow_is_no_part_of_the_object(ground, colour):
    picture = painted(shadowed(painted(ground).astype(np.float32)), (disc(), colour))
    assert overlap(cut_out(picture).image, disc()) > 0.93


def test_a_white_ribbed_object_on_white_is_not_eaten_away():
    ribs = (238 + 10 * np.cos(X / 4))[..., None] * np.ones(3)
    picture = painted((255, 255, 255))
    picture[disc()] = ribs[disc()]
    assert overlap(cut_out(picture).image, disc()) > 0.93


def test_a_pale_side_is_not_lost():
    box = (X > 40) & (X < 150) & (Y > 60) & (Y < 140)
    picture = painted((255, 255, 255), (box, (225, 225, 225)), (box & (X > 95), (248, 248, 247)))
    assert overlap(cut_out(picture).image, box) > 0.93


@pytest.mark.parametrize("light", ["to one side", "darker corners"])
def test_a_ground_may_grow_darker_from_place_to_place(light):
    away = X / SIZE if light == "to one side" else ((X - 96) ** 2 + (Y - 96) ** 2) / 2 / 96**2
    ground = np.array([180.0, 120, 200]) * (1 - 0.35 * away)[..., None]
    assert overlap(cut_out(painted(ground, (disc(), (60, 140, 60)))).image, disc()) > 0.95


def test_the_ground_shows_through_slats():
    slats = disc() & (X.astype(int) // 8 % 2 == 0)
    assert overlap(cut_out(painted((255, 255, 255), (slats, (110, 70, 40)))).image, slats) > 0.9


def test_thin_lines_of_a_drawing_stay():
    drawing = np.full((SIZE, SIZE, 3), 255, np.uint8)
    cv2.circle(drawing, (96, 96), 60, (20, 20, 20), 1, cv2.LINE_AA)
    dark = drawing[..., 0] < 100
    assert (cut_out(drawing).image[..., 3][dark] > 127).mean() > 0.95


def test_a_drawing_is_told_from_a_white_object_also_where_its_lines_lie_close_together():
    white, box = np.full((SIZE, SIZE, 3), 255, np.uint8), np.zeros((SIZE, SIZE), np.uint8)
    box[30:160, 40:150] = 255
    drawing = white.copy()
    # A line at every fourth pixel, which a picture of 96 pixels shows as one grey surface.
    for row in range(30, 160, 4):
        drawing[row, 40:150] = 0
    drawing[30:160, [40, 149]] = 0
    assert Cutout(np.dstack([drawing, box]), "alpha").is_drawing
    assert not Cutout(np.dstack([white, box]), "alpha").is_drawing
    outline = white.copy()
    outline[30:160, 40:42] = outline[30:32, 40:150] = 0
    assert Cutout(np.dstack([outline, box]), "alpha").is_drawing
    assert not cut_out(painted((255, 255, 255), (disc(), (110, 70, 40)))).is_drawing


TWO = disc(50, 96, 32), disc(145, 100, 26)
COLOURS = (150, 40, 40), (40, 60, 150)


def textured() -> np.ndarray:
    """A ground of which no two pixels are alike."""
    noise = np.random.default_rng(0).normal(size=(24, 24, 3)).astype(np.float32)
    return 150 + 40 * cv2.resize(noise, (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)


def test_of_several_things_one_is_taken_and_this_is_said():
    picture = painted((230, 230, 230), *zip(TWO, COLOURS, strict=True))
    cutout = cut_out(picture)
    assert overlap(cutout.image, TWO[0]) > 0.95
    (note,) = cutout.notes
    assert note.startswith("The picture shows 2 separate things; one of them was taken.")


def test_pieces_above_each_other_are_one_thing():
    top, foot = (np.abs(X - 96) < 70) & (np.abs(Y - 50) < 8), (np.abs(X - 96) < 30) & (np.abs(Y - 150) < 6)
    cutout = cut_out(painted((255, 255, 255), (top, (90, 60, 30)), (foot, (90, 60, 30))))
    assert overlap(cutout.image, top | foot) > 0.95
    assert cutout.notes == ()


@pytest.mark.parametrize("wanted", [0, 1])
@pytest.mark.parametrize("ground", ["plain", "textured"])
def test_a_stroke_says_which_thing_is_the_object(wanted, ground):
    picture = painted((230, 230, 230) if ground == "plain" else textured(), *zip(TWO, COLOURS, strict=True))
    marked, other = ((50, 96), (145, 100))[wanted], ((50, 96), (145, 100))[1 - wanted]
    strokes = [[(x - 12, y), (x + 12, y)] for x, y in (marked, other)]
    cutout = cut_out(picture, foreground=[strokes[0]], background=[strokes[1]])
    assert overlap(cutout.image, TWO[wanted]) > 0.85
    assert not cutout.image[other[1], other[0], 3]


def test_a_click_is_a_stroke_of_one_point():
    picture = painted((230, 230, 230), *zip(TWO, COLOURS, strict=True))
    assert overlap(cut_out(picture, foreground=[[[145, 100]]]).image, TWO[1]) > 0.85


def test_strokes_over_everything_leave_nothing_and_say_so():
    everything = [[[x, 0], [x, SIZE]] for x in range(0, SIZE, 2)]
    with pytest.raises(ImageError, match="No object was found"):
        cut_out(painted((230, 230, 230), (disc(), (90, 20, 20))), background=everything)
