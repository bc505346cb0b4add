"""Training pictures: they show what they say, whichever batches were made before."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from dipcg.camera import VIEW_NUMBERS, decode_view
from dipcg.config import AugmentConfig
from dipcg.data.codec import encode_mesh
from dipcg.data.shapes import Shapes
from dipcg.generators import load_generator
from dipcg.images import MARGIN
from dipcg.render import Renderer
from dipcg.training.pictures import Pictures
from dipcg.training.views import ViewBuffer

BOX = load_generator("box")
CPU = torch.device("cpu")


def shapes(count: int = 5) -> Shapes:
    rng = np.random.default_rng(0)
    many = [BOX.space.sample(rng) for _ in range(count)]
    x, active = (np.stack([of(params) for params in many]) for of in (BOX.space.encode, BOX.space.active))
    return Shapes([encode_mesh(BOX.build(params, "light")) for params in many], x.astype(np.float32), active)


@pytest.fixture(scope="module")
def boxes() -> Shapes:
    return shapes()


def buffer(boxes: Shapes, slots: int = 10, **config: float) -> ViewBuffer:
    return ViewBuffer(BOX, boxes, AugmentConfig(**config), slots, 3, CPU)


def test_a_view_shows_the_shape_that_it_is_said_to_show_from_its_camera(boxes):
    views = buffer(boxes, lines=0.0)
    views.advance(10, 48)
    found = views.draw(20, torch.Generator().manual_seed(0))
    renderer = Renderer(48)
    for view, x in zip(found.views, found.x.double().numpy(), strict=True):
        params = BOX.space.decode(x[:-VIEW_NUMBERS])
        alpha = renderer.render(BOX.build(params, "light"), decode_view(x[-VIEW_NUMBERS:]), margin=MARGIN)[..., 3]
        assert np.abs(alpha.astype(int) - view[3].numpy()).mean() < 6
    renderer.close()
    views.close()


def test_a_buffer_that_is_filled_anew_holds_the_same_views(boxes):
    grown, fresh = buffer(boxes), buffer(boxes)
    for number in (4, 13, 17):
        grown.advance(number, 32)
    fresh.advance(17, 32)
    for ours, theirs in zip(*(b.draw(50, torch.Generator().manual_seed(1)) for b in (grown, fresh)), strict=True):
        assert torch.equal(ours, theirs)


def test_every_shape_is_shown_once_before_any_is_shown_again(boxes):
    views = buffer(boxes)
    numbers = [views._shape(i) for i in range(15)]
    assert all(sorted(numbers[i : i + 5]) == [0, 1, 2, 3, 4] for i in (0, 5, 10))
    assert numbers[:5] != numbers[5:10]


@pytest.mark.parametrize(("config", "low", "high"), [({"extreme": 0.0}, 5, 45), ({"extreme": 1.0}, -25, 80)])
def test_extreme_views_reach_beyond_the_generators_range(boxes, config, low, high):
    views, rng = buffer(boxes, **config), np.random.default_rng(0)
    elevations = [views._view(BOX.space.decode(boxes.x[0].astype(float)), rng).elevation_deg for _ in range(300)]
    assert low <= min(elevations) < low + 5
    assert high - 5 < max(elevations) <= high


def test_a_batch_depends_on_its_step_alone(boxes):
    """So a run that was killed goes on with the batches that it would have had."""
    through, resumed = (Pictures(BOX, boxes, 8, seed=2, slots=16) for _ in range(2))
    for step in range(5):
        wanted = through.batch(step, 32)
    for ours, theirs in zip(wanted, resumed.batch(4, 32), strict=True):
        assert torch.equal(ours, theirs)
    assert through.batch(5, 48).images.shape == (8, 3, 48, 48)


def test_views_are_replaced_while_training(boxes):
    pictures = Pictures(BOX, boxes, 8, seed=2, slots=8)
    pictures.batch(0, 32)
    first = pictures.buffer._views.clone()
    pictures.batch(8, 32)
    assert (pictures.buffer._views != first).flatten(1).any(1).all()


def test_a_flipped_picture_has_the_mirrored_camera_and_parameters(boxes):
    generator = replace(BOX, mirrors={"width": "-width", "depth": "height", "height": "depth"})
    plain, flipped = (
        Pictures(generator, boxes, 6, 1, AugmentConfig(flip=flip), slots=6).batch(0, 32) for flip in (0.0, 1.0)
    )
    names = generator.space.names
    index, width = [names.index(name) for name in ("depth", "height")], names.index("width")
    torch.testing.assert_close(flipped.x[:, width], -plain.x[:, width])
    torch.testing.assert_close(flipped.x[:, index], plain.x[:, index[::-1]])
    for ours, theirs in zip(flipped.x.numpy(), plain.x.numpy(), strict=True):
        azimuths = [decode_view(x[-VIEW_NUMBERS:]).azimuth_deg for x in (ours, theirs)]
        assert azimuths[0] == pytest.approx(-azimuths[1], abs=1e-3)


def test_an_asset_without_a_mirror_image_is_never_flipped(boxes):
    plain, flipped = (
        Pictures(replace(BOX, mirrors=None), boxes, 6, 1, AugmentConfig(flip=flip), slots=6).batch(0, 32)
        for flip in (0.0, 1.0)
    )
    assert torch.equal(plain.x, flipped.x)
