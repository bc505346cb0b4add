"""A second look: the first candidate is corrected where that agrees better, and is never worse after it."""

from dataclasses import replace

import numpy as np
import pytest
from boxes import TRUTH, VIEW, among, picture, with_changes

from dipcg.camera import encode_view
from dipcg.inference import correct
from dipcg.inference.again import corrections, improved, look_again
from dipcg.inference.rank import rank
from dipcg.pipeline import Estimate
from dipcg.workers.process import BuildError

pytestmark = pytest.mark.slow
START = with_changes(height=0.8, width=0.7)
BIAS = 0.3


@pytest.fixture(scope="module")
def ranked(inverter) -> Estimate:
    return rank(among(inverter, picture(inverter), START, with_changes(has_legs=False)), inverter)


@pytest.fixture
def biased_reader(inverter, ranked, monkeypatch):
    """A network that reads every picture with the same bias: that of the truth first, then those of the candidate."""
    space, first = inverter.generator.space, ranked.candidates[0]
    readings = iter([(TRUTH, VIEW), *[(first.params, first.view)] * 9])

    def read(*_: object) -> np.ndarray:
        params, view = next(readings)
        return np.r_[space.encode(params), encode_view(view)] + BIAS

    monkeypatch.setattr(correct, "first_guess", read)


def test_what_the_network_reads_with_the_same_bias_leads_to_the_truth(inverter, ranked, biased_reader):
    found = look_again(ranked, inverter)
    assert found.params["height"] == pytest.approx(TRUTH["height"], abs=0.01)
    assert found.params["width"] == pytest.approx(TRUTH["width"], abs=0.01)
    assert found.candidates[0].agreement > ranked.candidates[0].agreement + 0.1
    assert [candidate.params for candidate in found.candidates[1:]] == [ranked.params]
    assert found.misfit == pytest.approx(1 - found.candidates[0].agreement)


def test_fixed_values_and_choices_stay(inverter, ranked, biased_reader):
    fixed = replace(ranked, fixed={"height": START["height"]})
    moved = corrections(fixed, inverter)
    assert [candidate.params["height"] for candidate in moved] == [START["height"]] * 2
    assert [candidate.params["has_legs"] for candidate in moved] == [START["has_legs"]] * 2


def test_a_correction_that_agrees_less_or_cannot_be_built_changes_nothing(inverter, ranked):
    space, truth = inverter.generator.space, rank(among(inverter, picture(inverter), TRUTH), inverter)
    wrong = [replace(ranked.candidates[0], mesh=None, agreement=None)]
    assert improved(truth, wrong, [inverter.build(START, "light").mesh], space) is truth
    assert improved(truth, wrong, [BuildError("raised", "It cannot be built.")], space) is truth


def test_what_is_not_ranked_stays(inverter, ranked):
    unranked = replace(ranked, misfit=None)
    assert look_again(unranked, inverter) is unranked
