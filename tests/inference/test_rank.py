"""Choosing among candidates by their renders, on boxes: the truth wins, cameras are found, failures go last."""

import pickle
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from boxes import BOX, TRUTH, VIEW, among, picture, untrained, with_changes, write_ball

from dipcg.camera import View
from dipcg.images import edges, prepare
from dipcg.inference.compare import SIDE, Picture
from dipcg.inference.rank import rank
from dipcg.inference.recognise import poor_fit, recognise, softmax
from dipcg.model.constraints import check_fixed, needed_options
from dipcg.pipeline import Inverter
from dipcg.space import Choice, ParameterSpace, Real


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> Iterator[Inverter]:
    with untrained(write_ball(tmp_path_factory.mktemp("ball"), most=0.9)) as inverter:
        yield inverter


@pytest.fixture(scope="module")
def image(inverter) -> np.ndarray:
    return picture(inverter)


@pytest.fixture(scope="module")
def sphere(ball) -> np.ndarray:
    return picture(ball, {"radius": 1.0, "hole": 0.5})


# Ranking


@pytest.mark.slow
def test_the_truth_comes_first_whatever_its_colours(inverter):
    others = [BOX.sample(np.random.default_rng(seed)) for seed in range(5)]
    for seed in range(3):
        found = rank(among(inverter, picture(inverter, seed=seed), *others, TRUTH), inverter)
        assert found.params == TRUTH
        assert found.candidates[0].agreement > 0.8
        assert found.misfit == 1 - found.candidates[0].agreement
        assert all(candidate.mesh is not None for candidate in found.candidates)


def test_the_closer_shape_agrees_better(inverter, image):
    heights = (0.9, 0.4, 0.6, 0.5)
    found = rank(among(inverter, image, *(with_changes(height=height) for height in heights)), inverter)
    assert [candidate.params["height"] for candidate in found.candidates] == [0.4, 0.5, 0.6, 0.9]
    agreements = [candidate.agreement for candidate in found.candidates]
    assert agreements == sorted(agreements, reverse=True)


def test_a_camera_that_is_a_little_off_is_found(inverter, image):
    wrong = View(VIEW.azimuth_deg + 9, VIEW.elevation_deg - 6, VIEW.distance)
    (found,) = rank(among(inverter, image, TRUTH, view=wrong), inverter).candidates
    assert found.view.azimuth_deg == pytest.approx(VIEW.azimuth_deg, abs=3)
    assert found.view.elevation_deg == pytest.approx(VIEW.elevation_deg, abs=3)


def test_nearly_the_same_candidates_are_merged_and_others_kept(inverter, image):
    near, far = with_changes(width=0.505), with_changes(width=0.6)
    found = rank(among(inverter, image, TRUTH, near, far, with_changes(has_legs=False)), inverter).candidates
    assert [c.params for c in found if c.params in (TRUTH, near)] == [found[0].params]
    assert far in [c.params for c in found]
    assert len(found) == 3


def test_a_candidate_that_cannot_be_built_goes_last(ball, sphere):
    unbuildable, good = {"radius": 1.0, "hole": 0.95}, {"radius": 1.0, "hole": 0.5}
    found = rank(among(ball, sphere, unbuildable, good), ball)
    assert [(c.params, c.mesh is None, c.agreement is None) for c in found.candidates] == [
        (good, False, False),
        (unbuildable, True, True),
    ]
    nothing = rank(among(ball, sphere, unbuildable), ball)
    assert nothing.misfit is None
    assert poor_fit(nothing) is None


def test_a_picture_of_something_else_is_said_to_be(inverter, image):
    across = np.abs(np.mgrid[-64:64, -64:64])
    cross = 255 * ((across.min(0) < 5) & (across.max(0) < 56)).astype(np.uint8)
    other = rank(among(inverter, np.dstack([np.full((128, 128, 3), 90, np.uint8), cross]), TRUTH), inverter)
    assert "nothing that 'box' can make" in poor_fit(other)
    assert poor_fit(rank(among(inverter, image, TRUTH), inverter)) is None


def test_an_estimate_is_plain_data_that_another_process_can_rank(inverter, image):
    """A pickle is how processes send values; there is no engine in it."""
    estimate = among(inverter, image, with_changes(height=0.9), TRUTH)
    sent = pickle.loads(pickle.dumps(estimate))
    with untrained("box") as other:
        again = rank(sent, other)
    expected = rank(estimate, inverter)
    assert [(c.params, c.view, c.agreement) for c in again.candidates] == [
        (c.params, c.view, c.agreement) for c in expected.candidates
    ]
    assert (again.generator, again.ref) == ("box", "box")


def test_a_worker_that_dies_costs_no_candidate(inverter, image):
    estimate = among(inverter, image, with_changes(height=0.9), TRUTH)
    list(inverter.pool.map([TRUTH]))
    for child in list(inverter.pool._children):
        child._process.kill()
    assert all(candidate.mesh is not None for candidate in rank(estimate, inverter).candidates)


# Comparing


def test_silhouettes_overlap_as_their_areas_say():
    def block(left: int) -> np.ndarray:
        square = np.zeros((SIDE, SIDE, 4), np.uint8)
        square[8:120, left : left + 60] = [90, 90, 90, 255]
        return square

    wide = np.zeros((SIDE, SIDE, 4), np.uint8)
    wide[8:120, 8:120] = 255
    assert Picture(wide, "alpha").match(block(8)).silhouette == pytest.approx(60 / 112, abs=0.02)
    same = Picture(block(34), "alpha").match(block(34))
    assert same.silhouette > 0.95
    assert same.lines > 0.9


def test_only_a_cut_out_that_can_be_trusted_is_compared_by_its_silhouette(image):
    drawing, _ = prepare(edges(image), SIDE)
    assert Picture(image, "alpha").match(image).silhouette > 0.98
    assert Picture(image, "photo").match(image).silhouette is None
    assert Picture(drawing, "drawing").match(image).silhouette is None


def test_an_estimate_knows_whether_it_was_made_from_a_drawing(inverter, image):
    assert [inverter.estimate(picture).background for picture in (edges(image), image)] == ["drawing", "alpha"]


def test_a_line_drawing_still_tells_the_truth_from_another_box(inverter, image):
    drawing = edges(image)
    found = rank(among(inverter, drawing, with_changes(height=0.8, width=0.9), TRUTH), inverter)
    assert found.params == TRUTH


# Fixed values


@pytest.mark.parametrize(
    ("fixed", "sentence"),
    [
        ({"widht": 1}, "There is no parameter 'widht'. Did you mean 'width'?"),
        ({"leg_height": 0.3, "has_legs": "no"},
         "leg_height does nothing when has_legs is False; hold only one of the two, or has_legs at True."),
        ({"top": "flat", "lid_height": 0.2},
         "lid_height does nothing when top is flat; hold only one of the two, or top at pyramid."),
        ({"width": 9}, "width must be a number from 0.3 to 1 m, got 9."),
    ],
)  # fmt: skip
def test_values_that_cannot_be_fixed_are_refused(inverter, image, fixed, sentence):
    with pytest.raises(ValueError) as error:
        inverter.estimate(image, fixed=fixed)
    assert str(error.value) == sentence


def test_two_that_need_different_options_cannot_both_be_fixed():
    space = ParameterSpace(
        Choice("back", ("bars", "slats", "plain")),
        Real("bar", 0, 1, when={"back": ("bars",)}),
        Real("slat", 0, 1, when={"back": ("slats",)}),
        Real("open", 0, 1, when={"back": ("bars", "slats")}),
    )
    with pytest.raises(ValueError, match="both be held: bar needs back to be bars, slat needs slats"):
        check_fixed(space, {"bar": 0.5, "slat": 0.5})
    assert needed_options(space, {"open": 0.5}) == {"back": ("bars", "slats")}
    assert needed_options(space, {"open": 0.5, "slat": 0.5}) == {"back": ("slats",)}


def test_fixed_values_do_something_in_every_candidate(inverter, image):
    found = inverter.estimate(image, candidates=6, steps=2, fixed={"lid_height": 0.2, "leg_height": 0.15})
    for candidate in found.candidates:
        assert {name: candidate.params[name] for name in ("top", "lid_height", "has_legs", "leg_height")} == {
            "top": "pyramid",
            "lid_height": 0.2,
            "has_legs": True,
            "leg_height": 0.15,
        }
    assert found.probabilities["top"] == {"open": 0.0, "flat": 0.0, "pyramid": 1.0}


def test_probabilities_of_a_choice_sum_to_one_and_favour_what_is_expected(inverter, image):
    found = inverter.estimate(image, candidates=1, steps=1)
    assert set(found.probabilities) == {"top", "has_legs"}
    for name, shares in found.probabilities.items():
        assert tuple(shares) == BOX[name].options
        assert sum(shares.values()) == pytest.approx(1, abs=1e-5)
        assert max(shares, key=shares.get) == found.params[name]


def test_samples_are_scaled_about_the_expected_candidate_and_nothing_else_moves(image):
    with untrained("box") as inverter:
        # These weights start at zero, and every sample would be the guess.
        torch.nn.init.normal_(inverter.model.denoiser.read, std=0.03)
        estimate = partial(inverter.estimate, image, candidates=12, steps=3, fixed={"width": 0.5, "has_legs": True})
        narrow = estimate()
        inverter.model.config = replace(inverter.model.config, calibration_scale=1.5)
        wide = estimate()
    assert (wide.params, wide.probabilities) == (narrow.params, narrow.probabilities)
    assert wide.spread["depth"] == pytest.approx(1.5 * narrow.spread["depth"], rel=0.1)
    assert wide.spread["leg_height"] > 1.2 * narrow.spread["leg_height"] > 0
    assert wide.spread["width"] == narrow.spread["width"] == 0


# Which generator


def test_a_ball_is_recognised_among_boxes(inverter, ball, sphere):
    probabilities = recognise(sphere, {"box": inverter, "ball": ball}, candidates=1)
    assert list(probabilities) == ["ball", "box"]
    assert probabilities["ball"] > 0.9
    assert sum(probabilities.values()) == pytest.approx(1)


def test_equal_agreements_leave_it_open():
    assert softmax({"a": 0.7, "b": 0.7}) == pytest.approx({"a": 0.5, "b": 0.5})
    assert softmax({"only": 0.1}) == {"only": 1.0}
