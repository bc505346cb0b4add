"""TOML files of strangers, which come with a Blender file: they name no code, no program and no other file."""

import hashlib
import re

import pytest

from dipcg.app.client import ApiError

BLENDER = b"BLENDER-v402"
SHA = hashlib.sha256(BLENDER).hexdigest()
TOML = f"""
blend = "lamp.blend"
object = "Lamp"
sha256 = "{SHA}"
[parameters.width]
input = "Socket_2"
kind = "real"
low = 0.1
high = 0.5
"""


def with_line(line: str) -> str:
    """The TOML file with another line at its top, in place of one with the same key."""
    key = line.partition(" =")[0]
    return "\n".join([line, *(other for other in TOML.splitlines() if not other.startswith(f"{key} ="))])


def test_a_toml_file_is_taken_with_its_blender_file(learning, folder):
    made = learning.propose(BLENDER, "lamp.blend", toml=TOML.encode())
    assert made["object"] == "Lamp"
    assert (folder / made["id"] / "given.toml").read_text() == TOML
    assert (folder / made["id"] / "lamp.blend").read_bytes() == BLENDER


MANY = "".join(f"[parameters.a{i}]\ninput = 'a'\nkind = 'real'\n" for i in range(501))
HOSTILE = {
    "a program": (with_line('blender = "/bin/sh"'), "names a program with `blender`"),
    "a seeded program": (with_line('program = "os:system"'), "names code with `program`"),
    "an OpenSCAD file": (with_line('scad = "/etc/passwd"'), "names code with `scad`"),
    "an entry": (with_line('entry = "evil:run"'), "names code with `entry`"),
    "a path up": (with_line('blend = "../../etc/lamp.blend"'), 'as `blend = "lamp.blend"`'),
    "a path from the root": (with_line('blend = "/etc/passwd"'), 'as `blend = "lamp.blend"`'),
    "no path": (with_line("blend = 7"), 'as `blend = "lamp.blend"`'),
    "another file": (with_line(f'sha256 = "{"0" * 64}"'), "written for another version of lamp.blend"),
    "an unknown key": (with_line('exec = "x"'), "exec: Extra inputs"),
    "another type": (with_line("object = []"), "object: Input should be a valid string"),
    "a hidden line": (TOML.replace(".width]", '."x]\\nblender = \\"/bin/sh\\"\\n[y"]'), "letters, digits and _"),
    "a hidden condition": (TOML + 'when = { "x]\\nblender = 1" = [1] }', "letters, digits and _"),
    "no number": (TOML.replace("0.1", "nan"), "low: Input should be"),
    "a text for a number": (TOML.replace("0.1", '"0.1"'), "low: Input should be a valid number"),
    "an endless number": (TOML.replace("0.1", "1" + "0" * 400), "low: "),
    "an unknown mirror": (with_line('mirrors = { width = "-depth" }'), "has 'depth', which is no parameter"),
    "no parameters": (TOML.partition("[")[0], "parameters: Field required"),
    "a table as parameter": (TOML.partition("[")[0] + "parameters = 1", "parameters: Input should be"),
    "many parameters": (
        TOML + "".join(f"[parameters.a{i}]\ninput = 'a'\nkind = 'real'\n" for i in range(501)),
        "at most 500",
    ),
    "no TOML": ("#!/bin/sh\nrm -rf /", "The TOML file cannot be read"),
    "no text": ("\udcff", "The TOML file cannot be read"),
    "a deep nest": ("a = " + "[" * 1900, "nested too deeply"),
    "a line that takes minutes": (".".join(["a"] * 60_000) + " = 1", "longer than 2000 bytes"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_toml_file_of_a_stranger_names_no_code_and_no_other_file(learning, folder, what):
    text, words = HOSTILE[what]
    with pytest.raises(ApiError, match=re.escape(words)) as error:
        learning.propose(BLENDER, "lamp.blend", toml=text.encode(errors="surrogateescape"))
    assert error.value.status == 422
    assert list(folder.iterdir()) == []


def test_a_toml_file_comes_with_a_blender_file_and_has_a_limit(learning, folder):
    with pytest.raises(ApiError, match="with a Blender file alone, got it with box"):
        learning.propose(b"width = 2; cube(width);", "box.scad", toml=TOML.encode())
    with pytest.raises(ApiError, match="less than or equal to 131072"):
        learning.propose(BLENDER, "lamp.blend", toml=b"#" * 131073)
    # The body ends before the TOML file does.
    with pytest.raises(ApiError, match="not a Blender file"):
        learning.send("POST", "/trainings?file=lamp.blend&toml=9999", TOML.encode(), "application/octet-stream")
    assert list(folder.iterdir()) == []
