"""Which parameters matter under which options, for a shape whose answer is known."""

import time

import numpy as np
import pytest

from dipcg.importing.effects import conditions
from dipcg.importing.search import find_effects, first_effects
from dipcg.mesh import make_mesh
from dipcg.space import Choice, ParameterSpace, Real

STYLES = ("straight", "stand", "wheels")
SPACE = ParameterSpace(
    Real("height", 1.0, 2.0),
    Choice("style", STYLES),
    Choice("corners", (4, 32)),
    Choice("poles", (4, 5), when={"style": ("wheels",)}),
    # These two matter under one style alone, and the last one with it under one number of poles.
    Real("spread", 0.5, 1.0),
    Real("turn", 0.5, 1.0),
)


def build(many):
    """A triangle whose corners say what matters."""
    for params in many:
        style = params["style"]
        spread = params["spread"] if style == "straight" else 0.1
        turn = params["turn"] if style == "wheels" and params["poles"] == 5 else 0.2
        legs = STYLES.index(style) + (params["poles"] if style == "wheels" else 0)
        yield make_mesh([[0, 0, 0], [legs + params["corners"], spread, 0], [0, params["height"], turn]], [[0, 1, 2]])


@pytest.mark.parametrize("seed", range(8))
def test_conditions_name_what_decides_and_not_what_happened_to_be_the_same(seed):
    effects = find_effects(SPACE, build, np.random.default_rng(seed))
    found = conditions(SPACE, SPACE.names, effects)
    # In one of some eight searches, no start has the only options under which `turn` matters.
    assert set(effects.without(SPACE)) <= {"turn"}
    assert found.pop("turn") in ({"style": ["wheels"], "poles": [5]}, {})
    expected = {"poles": {"style": ["wheels"]}, "spread": {"style": ["straight"]}}
    assert found == {"height": {}, "style": {}, "corners": {}} | expected


def test_the_nearer_end_is_tried_where_the_farther_one_fails():
    space, rng = ParameterSpace(Real("height", 1.0, 9.0), Real("unused", 0.0, 1.0)), np.random.default_rng(0)

    def small(many):
        for params in many:
            yield "too tall" if params["height"] > 8 else triangle(params["height"])

    start = {"height": 2.0, "unused": 0.5}
    found = first_effects(space, small, [start], time.monotonic() + 60)
    assert found.moved_from == {"height": [start]}
    assert found.without(space) == ["unused"]
    narrowed = ParameterSpace(Real("height", 1.0, 2.0))
    assert find_effects(narrowed, small, rng, found=found.within(narrowed)).moved_from["height"][0] == {"height": 2.0}
    assert found.within(ParameterSpace(Real("height", 3.0, 4.0))).moved_from == {}


def test_what_the_time_is_too_short_for_is_said():
    effects = find_effects(SPACE, build, np.random.default_rng(0), seconds=0.0)
    assert (effects.builds, effects.sizes) == (0, {})
    assert effects.notes() == ["Time ended before everything was tried; --seconds gives more."]
    assert find_effects(SPACE, build, np.random.default_rng(0)).notes() == []


def triangle(height):
    return make_mesh([[0, 0, 0], [1, 0, 0], [0, height, 0]], [[0, 1, 2]])
