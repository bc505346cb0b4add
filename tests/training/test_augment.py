"""Augmentation: each change has its own switch and does something, and what it imitates is right."""

from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
import torch
import trimesh

from dipcg.camera import View
from dipcg.config import AugmentConfig
from dipcg.generators import as_mesh
from dipcg.images import MARGIN
from dipcg.images import edges as canny
from dipcg.images import over_white as on_white
from dipcg.render import Look, Renderer
from dipcg.training.augment import augment, edges, over_white
from dipcg.training.faults import hide
from dipcg.training.jpeg import compress

NONE = AugmentConfig(**{field.name: 0.0 for field in fields(AugmentConfig)})
# Drawn where the camera and the parameters are known.
ELSEWHERE = {"views", "extreme", "flip", "lines"}
PLAIN = torch.zeros(1, dtype=torch.bool)


@pytest.fixture(scope="module")
def render():
    mesh = as_mesh(trimesh.creation.box((1.0, 0.7, 0.5)))
    renderer = Renderer(64)
    return lambda **look: np.ascontiguousarray(renderer.render(mesh, View(30.0, 25.0), Look(**look), MARGIN))


def batch(*images: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2).float() / 255


def rng(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_with_all_switched_off_the_view_is_shown_on_white(render):
    image = render()
    found = augment(batch(image), PLAIN, NONE, 64, rng())[0].permute(1, 2, 0) * 255
    np.testing.assert_allclose(found, on_white(image), atol=1.0)


@pytest.mark.parametrize("name", sorted({field.name for field in fields(AugmentConfig)} - ELSEWHERE))
def test_each_switch_changes_the_picture_by_itself_and_every_row_in_its_own_way(render, name):
    views = batch(*[render()] * 4)
    changed = augment(views, PLAIN.expand(4), replace(NONE, **{name: 1.0}), 64, rng(1))
    assert changed.shape == (4, 3, 64, 64)
    assert changed.min() >= 0
    assert changed.max() <= 1
    assert (changed - over_white(views)).abs().amax((1, 2, 3)).max() > 0.01
    if name not in ("mask", "edges"):
        assert (changed[0] != changed[1]).any()


def test_a_row_does_not_depend_on_the_others_being_there(render):
    """A change of some rows leaves the others as they are."""
    views = batch(*[render()] * 64)
    found = augment(views, PLAIN.expand(64), replace(NONE, background=0.5), 64, rng())
    same = (found - over_white(views)).abs().amax((1, 2, 3)) < 1e-6
    assert 16 < same.sum() < 48


def test_two_draws_differ_and_the_same_seed_gives_the_same_picture(render):
    views = batch(render())
    first, again, other = (augment(views, PLAIN, AugmentConfig(), 64, rng(seed)) for seed in (0, 0, 3))
    assert torch.equal(first, again)
    assert (first != other).any()


@pytest.mark.parametrize("size", [32, 48, 64, 96])
def test_another_size_shows_the_same_object_at_the_same_place(render, size):
    image = render()
    found = augment(batch(image), PLAIN, NONE, size, rng())[0].permute(1, 2, 0).numpy()
    wanted = cv2.resize(on_white(image), (size, size), interpolation=cv2.INTER_AREA) / 255
    assert found.shape == (size, size, 3)
    assert np.abs(found - wanted).mean() < 0.02


def test_views_of_normals_become_dark_lines_on_white(render):
    drawn = augment(batch(render(normals=True)), ~PLAIN, NONE, 64, rng())[0]
    assert drawn.median() == 1
    assert drawn.min() < 0.6
    assert (drawn == drawn[:1]).all()


def test_edges_are_those_of_opencv(render):
    """Within a pixel: OpenCV quantises directions and follows weak edges farther."""
    image = render()
    ours = edges(batch(image), rng())[0, 0].numpy() < 0.5
    theirs = canny(image)[..., 0] < 128
    near = [cv2.dilate(lines.astype(np.uint8), np.ones((3, 3))) > 0 for lines in (ours, theirs)]
    assert (ours & near[1]).sum() > 0.97 * ours.sum()
    assert (theirs & near[0]).sum() > 0.97 * theirs.sum()


def test_a_hidden_box_is_cut_out_or_painted(render):
    views = batch(*[render()] * 64)
    changed = hide(views, rng())
    cut = (changed[:, 3] != views[:, 3]).flatten(1).any(1)
    painted = (changed[:, :3] != views[:, :3]).flatten(1).any(1)
    assert not (cut & painted).any()
    assert cut.any()
    assert painted.any()
    assert ((changed != views).any(1).flatten(1).float().mean(1) < 0.15).all()


@pytest.mark.parametrize("size", [64, 60])
def test_jpeg_loses_what_the_real_one_loses(render, size):
    """The mean error of our codec is that of OpenCV's over the same qualities."""
    picture = on_white(cv2.resize(render(grain=np.full(1, 0.6)), (size, size)))
    ours = compress(batch(*[picture] * 64), rng())
    real = [
        cv2.imdecode(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)
        for quality in range(25, 90)
    ]
    ours_error = (ours - batch(picture)).abs().mean() * 255
    theirs_error = np.mean([np.abs(one.astype(float) - picture).mean() for one in real])
    assert ours_error == pytest.approx(theirs_error, rel=0.35)


def test_normals_tell_the_faces_of_a_box_apart_where_one_plain_colour_without_light_does_not(render):
    image = render(normals=True)
    inside = image[image[..., 3] == 255][:, :3]
    colours, counts = np.unique(inside, axis=0, return_counts=True)
    # The faces that this view sees.
    assert len(colours[counts > 20]) == 3
    flat = render(ambient=1.0, strengths=np.zeros(2), colours=np.full((1, 3), 0.5))
    assert np.ptp(flat[flat[..., 3] == 255][:, :3].astype(int), axis=0).max() <= 1
