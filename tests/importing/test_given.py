"""A TOML file that comes with its Blender file: its names and ranges are taken, where the inputs allow them."""

import shutil
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

from dipcg.generators import load_generator
from dipcg.importing.given import NOT_GIVEN, NOTE, take_given

EXAMPLES = Path(__file__).parents[2] / "examples"
# A name, a range and a text of its own.
OWN = """
[parameters.foot]
input = "Socket_17"
kind = "real"
low = 0.09
high = 0.12
unit = "m"
doc = "of the foot"
default = 0.1
"""

pytestmark = [pytest.mark.blender, pytest.mark.skipif(find_spec("bpy") is None, reason="bpy not installed")]


@pytest.fixture
def lamp(tmp_path) -> Path:
    return Path(shutil.copy(EXAMPLES / "lamp.blend", tmp_path / "lamp.blend"))


def given(folder: Path, parameters: str) -> Path:
    """A TOML file of the lamp with other parameters."""
    head = (EXAMPLES / "lamp.toml").read_text().partition("[parameters")[0].replace("mirrors", "# mirrors")
    (folder / "given.toml").write_text(head + parameters)
    return folder / "given.toml"


def test_the_generator_is_that_of_the_toml_file(lamp, tmp_path) -> None:
    shutil.copy(EXAMPLES / "lamp.toml", tmp_path / "given.toml")
    made = take_given(lamp, tmp_path / "given.toml", tmp_path / "made.toml")
    ours, theirs = load_generator(str(made.path)), load_generator(str(EXAMPLES / "lamp.toml"))
    assert [vars(p) for p in ours.space] == [vars(p) for p in theirs.space]
    assert (ours.doc, ours.mirrors, ours.inputs) == (theirs.doc, theirs.mirrors, theirs.inputs)
    assert (made.parameters, made.notes) == (theirs.space.names, [NOTE])


def test_names_ranges_and_what_is_left_out_are_its_own(lamp, tmp_path) -> None:
    made = take_given(lamp, given(tmp_path, OWN), tmp_path / "made.toml")
    foot = load_generator(str(made.path)).space["foot"]
    assert (foot.low, foot.high, foot.doc) == (0.09, 0.12, "of the foot")
    assert made.rows[0].value == "0.1"
    assert "Shade" in made.left_out
    assert "Base Radius" not in made.left_out
    assert set(made.left_out.values()) >= {NOT_GIVEN}
    # The range is narrower than the source's own, so it may be widened again.
    assert tomllib.loads(made.path.read_text())["parameters"]["foot"]["why"]


WRONG = {
    "no input": (("Socket_17", "Socket_99"), "has no input 'Socket_99'"),
    "no component": (('kind = "real"', 'component = "x"\nkind = "real"'), "has no input 'Socket_17 x'"),
    "another kind": (('kind = "real"', 'kind = "integer"'), "its input is a real"),
    "a wider range": (("0.09", "0.01"), "The source limits foot to 0.08 to 0.14, got 0.01 to 0.12"),
    "a falling range": (("0.12", "0.08"), "foot"),
    "two of one input": (("default = 0.1\n", "\n" + OWN.replace("foot", "foot_2")), "set the same input"),
    "an option": (
        (OWN, '[parameters.base]\ninput = "Socket_16"\nkind = "menu"\noptions = ["Sphere"]'),
        "option 'Sphere'",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_no_input_can_be_is_a_sentence_and_writes_nothing(lamp, tmp_path, what) -> None:
    (before, after), words = WRONG[what]
    with pytest.raises(ValueError, match=words):
        take_given(lamp, given(tmp_path, OWN.replace(before, after)), tmp_path / "made.toml")
    assert not (tmp_path / "made.toml").exists()
