"""Searching on from a candidate, on boxes."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import BOX, TRUTH, among, picture, with_changes

from dipcg.inference.rank import rank
from dipcg.inference.refine import PATIENCE, refine

pytestmark = pytest.mark.slow

# Seconds; the number of builds ends the search.
LONG = 1000.0


@pytest.fixture(scope="module")
def image(inverter) -> np.ndarray:
    return picture(inverter)


def apart(params: dict) -> float:
    return float(np.abs(BOX.encode(params) - BOX.encode(TRUTH))[BOX.reals].mean())


def test_a_search_comes_nearer_to_the_truth_and_says_how(inverter, image):
    start = with_changes(width=0.65, depth=0.65, height=0.55, leg_height=0.2, lid_height=0.2)
    ranked, steps = rank(among(inverter, image, start), inverter), []
    found = refine(ranked, inverter, LONG, steps.append, most_builds=120, seed=1)
    assert found.misfit < ranked.misfit - 0.05
    assert apart(found.params) < 0.6 * apart(start)
    assert [tuple(step) for step in found.trace[1:]] == [tuple(step) for step in steps]
    for before, after in zip(found.trace, found.trace[1:], strict=False):
        assert after.seconds > before.seconds
        assert after.builds > before.builds
    assert found.trace[-1].misfit < found.trace[0].misfit
    assert start in [candidate.params for candidate in found.candidates], "the others stay"


def test_a_wrong_choice_is_jumped_over(inverter, image):
    ranked = rank(among(inverter, image, with_changes(has_legs=False)), inverter)
    assert refine(ranked, inverter, LONG, most_builds=48).params["has_legs"] is True


def test_fixed_values_stay(inverter, image):
    fixed = {"width": 0.7, "top": "flat"}
    start = among(inverter, image, with_changes(**fixed))
    found = refine(replace(start, fixed=fixed), inverter, LONG, most_builds=24)
    for candidate in found.candidates:
        assert {name: candidate.params[name] for name in fixed} == fixed


def test_a_search_that_finds_nothing_better_ends(inverter, image):
    ranked = rank(among(inverter, image, TRUTH), inverter)
    found = refine(ranked, inverter, LONG)
    assert found.misfit <= ranked.misfit
    assert apart(found.params) < 0.1
    last = [step.misfit for step in found.trace[-PATIENCE:]]
    assert max(last) - min(last) < 0.01


@pytest.mark.parametrize("seconds", [0, -3, float("nan")])
def test_no_time_is_no_search(inverter, image, seconds):
    with pytest.raises(ValueError, match="A search needs more than 0 seconds"):
        refine(among(inverter, image, TRUTH), inverter, seconds)
