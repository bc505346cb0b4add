"""Augmentation: each change has its own switch, does something, and keeps the picture a picture."""

from dataclasses import fields, replace

import numpy as np
import pytest
import trimesh

from dipcg.camera import View
from dipcg.config import AugmentConfig
from dipcg.generators import as_mesh
from dipcg.images import MARGIN, over_white
from dipcg.render import Look, Renderer
from dipcg.training.augment import augment

NONE = AugmentConfig(**{field.name: 0.0 for field in fields(AugmentConfig)})
OF_THE_ANSWER = {"views", "flip", "lines"}  # made where the camera and the parameters are known, in dataset.py


@pytest.fixture(scope="module")
def render():
    mesh = as_mesh(trimesh.creation.box((1.0, 0.7, 0.5)))
    renderer = Renderer(64)
    return lambda **look: renderer.render(mesh, View(30.0, 25.0), Look(**look), MARGIN)


def test_with_all_switched_off_the_picture_is_left_alone(render):
    image = render()
    np.testing.assert_array_equal(augment(image, NONE, np.random.default_rng(0)), over_white(image))


@pytest.mark.parametrize("name", sorted({field.name for field in fields(AugmentConfig)} - OF_THE_ANSWER))
def test_each_switch_changes_the_picture_by_itself(render, name):
    image, config = render(), replace(NONE, **{name: 1.0})
    changed = augment(image, config, np.random.default_rng(0))
    assert changed.shape == (64, 64, 3)
    assert (changed != over_white(image)).any()


def test_two_draws_differ_and_the_same_seed_gives_the_same_picture(render):
    image, config = render(), AugmentConfig()
    first, again, other = (augment(image, config, np.random.default_rng(seed)) for seed in (0, 0, 3))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_a_drawing_has_dark_lines_on_white_whatever_the_colours(render):
    drawn = augment(render(normals=True), NONE, np.random.default_rng(0), drawing=True)
    assert np.median(drawn) == 255
    assert drawn.min() < 150
    assert (drawn == drawn[..., :1]).all()


def test_normals_tell_the_faces_of_a_box_apart_where_one_plain_colour_without_light_does_not(render):
    image = render(normals=True)
    inside = image[image[..., 3] == 255][:, :3]
    colours, counts = np.unique(inside, axis=0, return_counts=True)
    assert len(colours[counts > 20]) == 3  # the faces that this view sees
    flat = render(ambient=1.0, strengths=np.zeros(2), colours=np.full((1, 3), 0.5))
    assert np.ptp(flat[flat[..., 3] == 255][:, :3].astype(int), axis=0).max() <= 1
