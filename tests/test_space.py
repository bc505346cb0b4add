"""The parameter space: the projection to x and back, what is active, validation and JSON."""

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from dipcg.parameter_file import params_from_json, params_to_json
from dipcg.space import Choice, ParameterSpace, Real

SPACE = ParameterSpace(
    Real("width", 0.3, 0.8, unit="m", doc="of the seat"),
    Choice("leg_type", ("vertical", "straight", "curved"), doc="shape of the legs"),
    Real("leg_offset", 0.0, 0.2, default=0.05, when={"leg_type": ("straight", "curved")}),
    Choice("has_arm", (False, True)),
    Choice("arm_type", ("round", "square"), default="square", when={"has_arm": (True,)}),
    Real("arm_corner", 0.0, 1.0, when={"arm_type": ("square",), "leg_type": ("vertical",)}),
    Choice("cuts", (1, 2, 3, 4)),
)
XS = npst.arrays(float, len(SPACE), elements=st.floats(-1, 1))
PARAMS = XS.map(SPACE.decode)


@given(PARAMS)
def test_decoding_undoes_encoding(params):
    assert SPACE.decode(SPACE.encode(params)) == pytest.approx(params, abs=1e-12)


@given(XS)
def test_decoding_and_encoding_again_changes_nothing_more(x):
    once = SPACE.encode(SPACE.decode(x))
    np.testing.assert_allclose(SPACE.encode(SPACE.decode(once)), once, atol=1e-12)
    assert (np.abs(once) <= 1).all()


@given(npst.arrays(float, len(SPACE), elements=st.floats(-1e6, 1e6)))
def test_x_out_of_range_counts_as_the_nearest_end(x):
    assert SPACE.decode(x) == SPACE.decode(x.clip(-1, 1))


@given(PARAMS)
def test_canonical_form_is_canonical(params):
    assert SPACE.canonical(params) == params


@given(st.integers(0, 2**32 - 1))
def test_samples_are_canonical_valid_and_follow_the_seed(seed):
    params = SPACE.sample(np.random.default_rng(seed))
    assert SPACE.validate(params) == params
    assert SPACE.sample(np.random.default_rng(seed)) == params


def test_reals_are_scaled_to_minus_one_to_one():
    width = SPACE["width"]
    assert [width.encode(v) for v in (0.3, 0.55, 0.8)] == pytest.approx([-1, 0, 1])
    assert [width.decode(x) for x in (-1.0, 0.0, 1.0)] == pytest.approx([0.3, 0.55, 0.8])


def test_choices_are_equal_pieces_of_minus_one_to_one():
    cuts = SPACE["cuts"]
    np.testing.assert_allclose(cuts.centres, [-0.75, -0.25, 0.25, 0.75])
    assert [cuts.decode(x) for x in (-1.0, -0.51, -0.49, 0.01, 0.51, 1.0)] == [1, 1, 2, 3, 4, 4]


def test_options_are_drawn_equally_often():
    rng = np.random.default_rng(0)
    drawn = [SPACE.sample(rng)["cuts"] for _ in range(2000)]
    assert [drawn.count(option) / 2000 for option in (1, 2, 3, 4)] == pytest.approx([0.25] * 4, abs=0.04)


def test_a_parameter_is_active_only_where_its_whole_chain_is():
    def is_active(**choices):
        return SPACE.is_active("arm_corner", params(**choices))

    assert is_active(has_arm=True, arm_type="square", leg_type="vertical")
    assert not is_active(has_arm=True, arm_type="square", leg_type="curved")
    assert not is_active(has_arm=True, arm_type="round", leg_type="vertical")
    assert not is_active(has_arm=False, arm_type="square", leg_type="vertical"), "arm_type itself is inactive here"


def test_active_is_a_flag_per_position_of_x():
    active = SPACE.active(params(leg_type="curved", has_arm=False))
    assert dict(zip(SPACE.names, active.tolist(), strict=True)) == {
        "width": True,
        "leg_type": True,
        "leg_offset": True,
        "has_arm": True,
        "arm_type": False,
        "arm_corner": False,
        "cuts": True,
    }


def test_inactive_parameters_take_their_default_or_the_middle():
    canonical = SPACE.canonical(
        params(leg_type="vertical", leg_offset=0.2, has_arm=False, arm_type="round", arm_corner=0.9)
    )
    assert canonical["leg_offset"] == 0.05
    assert canonical["arm_type"] == "square"
    assert canonical["arm_corner"] == 0.5


@pytest.mark.parametrize(
    ("name", "typed", "meant"),
    [
        ("has_arm", "1", True),
        ("has_arm", "yes", True),
        ("has_arm", "True", True),
        ("has_arm", "on", True),
        ("has_arm", 1, True),
        ("has_arm", "0", False),
        ("has_arm", "No", False),
        ("has_arm", "off", False),
        ("has_arm", 0.0, False),
        ("cuts", "3", 3),
        ("cuts", 3.0, 3),
        ("cuts", np.int64(3), 3),
        ("leg_type", "Curved", "curved"),
        ("width", "0.5", 0.5),
        ("width", np.float32(0.5), 0.5),
    ],
)
def test_what_people_type_is_understood(name, typed, meant):
    value = SPACE.replace(params(), {name: typed})[name]
    assert value == meant
    assert type(value) is type(meant)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"widht": 0.5}, "There is no parameter 'widht'. Did you mean 'width'?"),
        ({"xyzzy": 0.5}, "There is no parameter 'xyzzy'."),
        ({"width": 0.81}, "width must be a number from 0.3 to 0.8 m, got 0.81."),
        ({"width": "wide"}, "width must be a number from 0.3 to 0.8 m, got 'wide'."),
        ({"width": math.nan}, "width must be a number from 0.3 to 0.8 m, got nan."),
        ({"width": True}, "width must be a number from 0.3 to 0.8 m, got True."),
        ({"width": None}, "width must be a number from 0.3 to 0.8 m, got None."),
        (
            {"leg_type": "curvd"},
            "leg_type must be one of vertical, straight, curved, got 'curvd'. Did you mean 'curved'?",
        ),
        ({"cuts": 5}, "cuts must be one of 1, 2, 3, 4, got 5."),
        ({"cuts": "half"}, "cuts must be one of 1, 2, 3, 4, got 'half'."),
        ({"cuts": 2.5}, "cuts must be one of 1, 2, 3, 4, got 2.5. Did you mean '2'?"),
        ({"cuts": True}, "cuts must be one of 1, 2, 3, 4, got True."),
        ({"has_arm": "maybe"}, "has_arm must be one of False, True, got 'maybe'."),
    ],
)
def test_bad_values_get_a_sentence(changes, sentence):
    with pytest.raises(ValueError) as error:
        SPACE.replace(params(), changes)
    assert str(error.value) == sentence


def test_a_full_set_must_be_full():
    with pytest.raises(ValueError, match="These parameters are missing: width, cuts\\."):
        SPACE.validate({k: v for k, v in params().items() if k not in ("width", "cuts")})


def test_replacing_leaves_the_original_alone_and_stays_canonical():
    before = params(has_arm=True, arm_type="round")
    after = SPACE.replace(before, {"has_arm": "no"})
    assert after["arm_type"] == "square"
    assert before["arm_type"] == "round"


@given(PARAMS)
def test_json_keeps_every_value(params):
    assert params_from_json(params_to_json(params, "chair")) == ("chair", params)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "{}", '{"params": {}}', '{"generator": "chair", "params": 3}'])
def test_what_is_no_parameter_file_gets_a_sentence(text):
    with pytest.raises(ValueError, match="A parameter file is JSON like"):
        params_from_json(text)


def declared(**changes) -> ParameterSpace:
    real = {"low": 0.0, "high": 1.0, "unit": "m", "doc": "d", "group": "g", "when": {"b": (1,)}}
    options = changes.pop("options", (1, 2))
    return ParameterSpace(Real(changes.pop("name", "a"), **(real | changes)), Choice("b", options))


@pytest.mark.parametrize("change", [{"doc": "other"}, {"unit": "cm"}, {"group": "other"}])
def test_words_do_not_change_the_fingerprint(change):
    assert declared(**change).fingerprint == declared().fingerprint


@pytest.mark.parametrize(
    "change",
    [{"low": -1.0}, {"high": 2.0}, {"name": "c"}, {"when": {}}, {"when": {"b": (2,)}}, {"options": (1, 3)},
     {"options": (1, 2, 3)}, {"options": (2, 1)}, {"default": 0.1}],
)  # fmt: skip
def test_ranges_options_and_conditions_change_the_fingerprint(change):
    assert declared(**change).fingerprint != declared().fingerprint


def test_the_order_of_parameters_changes_the_fingerprint():
    a, b = Real("a", 0.0, 1.0), Real("b", 0.0, 1.0)
    assert ParameterSpace(a, b).fingerprint != ParameterSpace(b, a).fingerprint


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ([Real("a", 0.0, 1.0), Choice("a", (1, 2))], "unique"),
        ([Real("a", 1.0, 1.0)], "low must be below high"),
        ([Real("a", 0.0, 1.0, default=1.5)], "default 1.5 is not from 0.0 to 1.0"),
        ([Choice("a", (1,))], "at least two"),
        ([Choice("a", (1, 1))], "at least two"),
        ([Choice("a", (1, 2), default=3)], "default 3 is not one of"),
        ([Real("a", 0.0, 1.0, when={"b": (1,)})], "must name a choice"),
        ([Real("a", 0.0, 1.0), Real("b", 0.0, 1.0, when={"a": (1,)})], "must name a choice"),
        ([Choice("a", (1, 2)), Real("b", 0.0, 1.0, when={"a": (3,)})], "must name a choice"),
        ([Choice("a", (1, 2)), Real("b", 0.0, 1.0, when={"a": ()})], "must name a choice"),
        ([Choice("a", (1, 2), when={"b": (1,)}), Choice("b", (1, 2), when={"a": (1,)})], "leads back to itself"),
        ([Choice("a", (1, 2), when={"a": (1,)})], "leads back to itself"),
    ],
)
def test_a_contradictory_declaration_is_refused(parameters, sentence):
    with pytest.raises(ValueError, match=sentence):
        ParameterSpace(*parameters)


@pytest.mark.parametrize(
    ("when", "sentence"),
    [
        ({"a": 1}, "b: `when` lists options, as in {'a': (1,)}; got 1."),
        (("a", 1), "b: `when` is a dictionary from a choice to options, got ('a', 1)."),
    ],
)
def test_conditions_of_a_wrong_type_name_the_parameter(when, sentence):
    # In a process without the checks of types, as users have it.
    declaration = f"ParameterSpace(Choice('a', (1, 2)), Real('b', 0.0, 1.0, when={when}))"
    code = f"from dipcg.space import Choice, ParameterSpace, Real\n{declaration}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stderr.strip().endswith(f"ValueError: {sentence}")


def test_an_unknown_name_gets_the_nearest():
    with pytest.raises(KeyError, match="Did you mean 'width'"):
        SPACE["widths"]


def params(**changes):
    full = {"width": 0.5, "leg_type": "vertical", "leg_offset": 0.1, "has_arm": True}
    return full | {"arm_type": "round", "arm_corner": 0.2, "cuts": 1} | changes
