"""Ranges that are proposed for inputs without limits, as a person would choose them."""

import gzip

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from dipcg.importing.header import saved_by
from dipcg.importing.proposal import held, propose, rounded

NUMBER = {"kind": "real", "subtype": "NONE", "low": None, "high": None, "others": {}}


@pytest.mark.parametrize(
    ("name", "value", "more", "expected"),
    [
        ("Thickness", 0.34, {"subtype": "DISTANCE"}, (0.17, 0.7)),
        ("Trunk Height", 3.0, {"subtype": "DISTANCE"}, (1.5, 6)),
        ("Canopy Radius", 1.0, {"subtype": "DISTANCE", "low": 0.0}, (0.5, 2)),
        ("Trunk Bump", 1.28, {}, (0, 2.6)),
        ("Depth", -0.2, {}, (-0.4, -0.1)),
        ("Lean", 30.0, {"subtype": "ANGLE"}, (15, 60)),
        ("Lean", -120.0, {"subtype": "ANGLE"}, (-180, -60)),
        ("Lean", 0.0, {"subtype": "ANGLE"}, (-45, 45)),
        ("Taper", 0.5, {"subtype": "FACTOR"}, (0, 1)),
        ("Fill", 40.0, {"subtype": "PERCENTAGE"}, (0, 100)),
        ("Backrest Scale", 0.52, {}, (0.26, 1)),
        ("Scale", 1.0, {}, (0.5, 2)),
        ("Shift X", 0.0, {"subtype": "TRANSLATION"}, (-0.5, 0.5)),
        ("Gap", 0.0, {"subtype": "DISTANCE"}, (0, 0.5)),
        ("Gap", 0.0, {}, (0, 1)),
        ("Legs", 4, {"kind": "integer"}, (2, 8)),
        ("Rings", 1, {"kind": "integer"}, (1, 3)),
        ("Rings", 0, {"kind": "integer"}, (0, 3)),
        ("Legs Type", 2, {"kind": "integer"}, (0, 5)),
        ("Height", 3.0, {"others": {"Small": 0.5, "Same": 2.0}}, (0.5, 6)),
        ("Height", 3.0, {"low": 2.0}, (2, 6)),
        # Limits of the file stay, unless they are far wider than what the value suggests.
        ("Angle", 19.44, {"low": 0.0, "high": 45.0}, (0, 45)),
        ("Shift", 0.1, {"low": -1.0, "high": 1.0}, (-1, 1)),
        ("Height", 3.0, {"low": 0.0, "high": 1000.0}, (1.5, 6)),
    ],
)
def test_a_range_is_what_a_maker_expects(name, value, more, expected):
    proposed = propose(NUMBER | {"name": name, "default": value} | more, side=2.0)
    assert (proposed.low, proposed.high) == pytest.approx(expected)
    assert bool(proposed.why) == ((more.get("low"), more.get("high")) != expected)


@given(value=st.floats(0.001, 1000), negative=st.booleans(), kind=st.sampled_from(["real", "integer"]))
def test_a_range_holds_the_value_and_keeps_its_sign(value, negative, kind):
    value = -value if negative else value
    value = round(value) or 1 if kind == "integer" else value
    proposed = propose(NUMBER | {"name": "Height", "default": value, "kind": kind}, side=1.0)
    assert proposed.low <= value <= proposed.high
    assert proposed.low < proposed.high
    assert proposed.low * proposed.high > 0
    assert max(proposed.low / value, proposed.high / value) <= (3 if kind == "integer" else 2.1)


def test_seed_and_resolution_are_held():
    assert held("Seed").startswith("a seed is held")
    assert held("trunkResolution").startswith("a resolution is held")
    assert not held("Trunk Radius")


@given(st.floats(1e-6, 1e6))
def test_rounding_stays_within_a_twentieth(value):
    assert rounded(value) == pytest.approx(value, rel=0.05)
    # Two digits are always enough, as the step between numbers of two digits is at most a tenth of them.
    assert float(f"{rounded(value):.1e}") == rounded(value)


@pytest.mark.parametrize(
    ("header", "version"),
    [(b"BLENDER-v402", (4, 2)), (b"BLENDER_V276", (2, 76)), (b"BLENDER17-01v0501", (5, 1))],
)
@pytest.mark.parametrize("packed", [bytes, gzip.compress, zstandard.ZstdCompressor().compress])
def test_the_header_tells_the_version_of_blender(tmp_path, header, version, packed):
    path = tmp_path / "a.blend"
    path.write_bytes(packed(header + b"REND" + bytes(100)))
    assert saved_by(path) == version


@pytest.mark.parametrize("content", [b"", b"a lamp", b"BLENDER", b"\x28\xb5\x2f\xfd???", b"\x1f\x8b???"])
def test_what_is_no_blender_file_is_said(tmp_path, content):
    path = tmp_path / "a.blend"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="is not a Blender file"):
        saved_by(path)
