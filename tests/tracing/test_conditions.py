"""Under which choices something exists, from runs with and without it."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from dipcg.tracing.conditions import condition

RUNS = list(itertools.product(("flat", "cone", "dome"), (False, True), (1, 2, 3)))
CHOICES = {name: [run[i] for run in RUNS] for i, name in enumerate(("roof", "door", "floors"))}


def test_what_is_always_there_has_no_condition():
    assert condition([True] * len(RUNS), CHOICES) == {}


def test_what_is_never_there_has_none_that_can_be_known():
    assert condition([False] * len(RUNS), CHOICES) is None


@given(st.sets(st.sampled_from(("flat", "cone", "dome")), min_size=1, max_size=2), st.booleans())
def test_a_condition_of_two_choices_is_found(roofs, door):
    there = [run[0] in roofs and run[1] == door for run in RUNS]
    found = condition(there, CHOICES)
    assert found == {"roof": tuple(sorted(roofs)), "door": (door,)}


def test_what_no_choice_explains_has_no_condition():
    there = [index % 2 == 0 for index in range(len(RUNS))]
    there[0], there[2] = True, False
    assert condition(there, {"roof": CHOICES["roof"]}) is None


def test_a_choice_that_is_not_always_there_explains_nothing_beyond_itself():
    inner = [run[2] if run[1] else None for run in RUNS]
    assert condition([run[1] and run[2] > 1 for run in RUNS], CHOICES | {"inner": inner}) is not None
    assert condition([not run[1] for run in RUNS], {"inner": inner}) is None
