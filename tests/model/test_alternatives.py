"""Which options are assumed for some of the candidates, and how probability is shared among candidates."""

import numpy as np
import pytest
import torch
from boxes import untrained

from dipcg.model.alternatives import LEAST, alternatives, shares
from dipcg.space import Choice, ParameterSpace, Real

SPACE = ParameterSpace(
    Choice("legs", (1, 2, 4), doc="number of legs"),
    Choice("top", ("round", "square"), doc="outline"),
    Choice("rim", ("none", "sharp"), doc="of a round top", when={"top": ("round",)}),
    Real("height", 0.3, 0.8, unit="m", doc="of the top"),
)
EXPECTED = {"legs": 4, "top": "round", "rim": "none", "height": 0.5}
PROBABILITIES = {"legs": {1: 0.21, 2: 0.05, 4: 0.74}, "top": {"round": 0.6, "square": 0.4}} | {
    "rim": {"none": 0.85, "sharp": 0.15}
}


def test_every_doubtful_option_is_assumed_alone_and_in_pairs_the_likeliest_first():
    found = alternatives(SPACE, EXPECTED, PROBABILITIES, {})
    assert found[:3] == [{"top": "square"}, {"legs": 1}, {"legs": 1, "top": "square"}]
    assert {"legs": 1, "rim": "sharp"} in found
    assert {"legs": 2} not in found


def test_options_that_cannot_go_together_or_are_fixed_are_not_assumed():
    assert {"top": "square", "rim": "sharp"} not in alternatives(SPACE, EXPECTED, PROBABILITIES, {})
    assert all("top" not in options for options in alternatives(SPACE, EXPECTED, PROBABILITIES, {"top": "round"}))


def test_choices_without_effect_are_not_assumed():
    square = EXPECTED | {"top": "square"}
    assert all("rim" not in options for options in alternatives(SPACE, square, PROBABILITIES, {}))


def test_each_kind_has_its_probability_however_many_candidates_it_has():
    kinds = [(legs, top) for legs in (4, 4, 4, 1) for top in ("round", "square")]
    many = [EXPECTED | {"legs": legs, "top": top} for legs, top in kinds]
    sure = PROBABILITIES | {"rim": {"none": 1.0, "sharp": 0.0}}
    of_each = dict.fromkeys(kinds, 0.0)
    for kind, share in zip(kinds, shares(SPACE, many, sure), strict=True):
        of_each[kind] += share
    four, one = {(4, "round"): 0.444, (4, "square"): 0.296}, {(1, "round"): 0.126, (1, "square"): 0.084}
    assert of_each == pytest.approx(four | one)


def test_candidates_of_a_network_in_doubt_have_every_likely_option():
    with untrained("box") as inverter:
        torch.nn.init.zeros_(inverter.model.guess.weight)
        estimate = inverter.estimate(np.full((64, 64, 4), 255, np.uint8) * np.tri(64, dtype=np.uint8)[..., None])
    (choice, probabilities), *_ = estimate.probabilities.items()
    assert {c.params[choice] for c in estimate.candidates} >= {o for o, p in probabilities.items() if p > LEAST}
    for candidate in estimate.candidates:
        assert candidate.assumed.items() <= candidate.params.items()
    assert sum(bool(candidate.assumed) for candidate in estimate.candidates) in range(1, 8)
    assert len(estimate.candidates) == 16
