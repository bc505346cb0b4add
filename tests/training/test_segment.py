"""The segmenter: what it learns from, that it learns, and that the one that ships finds objects it never saw."""

import numpy as np
import pytest
import torch

from dipcg.images.segmenter import FILE, SIDE, Segmenter, probability
from dipcg.training import grounds
from dipcg.training.grounds import sample_ground, sample_scene
from dipcg.training.segment import ScenePool, _loss, fit_segmenter, save_segmenter


def ball(colour: tuple[int, int, int]) -> np.ndarray:
    y, x = np.mgrid[:64, :64]
    view = np.zeros((64, 64, 4), np.uint8)
    view[..., :3] = colour
    view[..., 3] = 255 * (np.hypot(x - 31.5, y - 31.5) < 28)
    return view


VIEWS = [ball((200, 40, 40)), ball((40, 160, 60))]


@pytest.mark.parametrize("kind", ["studio", "clouds", "planks", "tiles", "clutter", "room"])
def test_grounds_are_pictures_and_differ(kind):
    one, other = (getattr(grounds, kind)(64, np.random.default_rng(seed)) for seed in (0, 1))
    assert one.shape == (64, 64, 3)
    assert np.isfinite(one).all()
    assert (one != other).any()


def test_a_piece_of_a_photograph_is_a_ground_too():
    photograph = np.full((50, 80, 3), 0.123, np.float32)
    found = [sample_ground(32, np.random.default_rng(seed), [photograph]) for seed in range(40)]
    assert any(np.allclose(ground, 0.123) for ground in found)


def test_a_scene_shows_the_view_where_the_coverage_says():
    for seed in range(20):
        picture, coverage = sample_scene(VIEWS, 64, np.random.default_rng(seed))
        assert picture.shape == (64, 64, 3)
        ys, xs = np.nonzero(coverage > 0.5)
        assert 0.3 < max(np.ptp(xs), np.ptp(ys)) / 64 < 1
        assert np.ptp(xs) == pytest.approx(np.ptp(ys), abs=2)


def test_the_same_seed_gives_the_same_batches():
    first, again = (ScenePool(VIEWS, [], np.random.default_rng(3)).batch() for _ in range(2))
    assert torch.equal(first[0], again[0])
    assert torch.equal(first[1], again[1])
    assert first[0].shape[1:] == (3, SIDE, SIDE)


def test_it_is_fitted_and_stored(tmp_path):
    losses = []
    network = fit_segmenter(VIEWS, [], 3, report=lambda step, loss: losses.append(loss))
    assert len(losses) == 3
    assert np.isfinite(losses).all()
    save_segmenter(network, tmp_path / "a.safetensors", {"steps": 3})
    assert "steps" in (tmp_path / "a.json").read_text()


def test_the_loss_is_little_where_the_object_is_found():
    _, coverage = ScenePool(VIEWS, [], np.random.default_rng(0)).batch()
    right = 20 * (coverage - 0.5)
    assert _loss(right, coverage) < 0.15 < 1 < _loss(-right, coverage)


def test_the_one_that_ships_is_small_complete_and_finds_a_ball():
    from safetensors.torch import load_file

    assert FILE.stat().st_size < 1_000_000
    missing = Segmenter().load_state_dict(load_file(FILE), strict=False).missing_keys
    assert all(name.endswith("num_batches_tracked") for name in missing)
    y, x = np.mgrid[:120, :160]
    picture = np.dstack([90 + x // 4, 120 + y // 3, 100 + (x + y) // 8]).astype(np.uint8)
    inside = np.hypot(x - 80, y - 60) < 35
    picture[inside] = (180, 50, 40)
    likely = probability(picture)
    assert likely.shape == (120, 160)
    assert likely[inside].mean() > 0.7
    assert likely[~inside].mean() < 0.1
