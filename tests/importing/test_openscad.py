"""OpenSCAD files as generators: the Customizer's comments, the files of the program, and the whole way to an asset."""

import json
import shlex
import shutil
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dipcg.images import save_image
from dipcg.importing.openscad import import_scad
from dipcg.openscad.customizer import customizer
from dipcg.openscad.declaration import assignments, read_off

EXAMPLE = Path(__file__).parents[2] / "examples" / "fluted_vase.scad"
needs_openscad = pytest.mark.skipif(shutil.which("openscad") is None, reason="openscad is not installed")
TRAIN = """
import sys
from dipcg.cli import main
from dipcg.training import train
train.VALIDATION_PICTURES = 4
main(sys.argv[1:])
"""
COMMANDS = """
dipcg generators add vase.scad --seconds 20
dipcg sample ./vase.toml -o vase.glb --set outline=square has_rim=no --params-out vase.json
dipcg dataset build ./vase.toml --count 30 -o data
dipcg train ./vase.toml --data data --pictures 128 --denoiser-share 0.5 --depth 1 --batch 16 -o run
dipcg estimate vase.png -g run/vase --candidates 2 --steps 2 -o found.glb --params-out found.json
dipcg edit found.json --set height=180 -o taller.glb
"""


def test_comments_of_the_customizer_become_parameters():
    entries, left_out = customizer(
        """
        // The height
        height = 12; // [10:20]
        width = 3.5; // [2:0.5:6]
        count = 4; // [9]
        /* [Style] */
        kind = "a"; // [a:Round, b:Square]
        size = 20; // [10, 20, 30]
        open = true;
        free = 8;
        at = [1, 2, 3]; // [0:0.1:5]
        name = "text";
        twice = 2 * free;
        /* [Hidden] */
        $fn = 50;
        secret = 4;
        module part() { inner = 3; }
        below = 5;
        """
    )
    read = {name: (e["kind"], e.get("options") or (e.get("low"), e.get("high"))) for name, e in entries.items()}
    assert read == {
        "height": ("integer", (10, 20)),
        "width": ("real", (2.0, 6.0)),
        "count": ("integer", (0, 9)),
        "kind": ("menu", ["a", "b"]),
        "size": ("menu", [10, 20, 30]),
        "open": ("boolean", (None, None)),
        "free": ("real", (4.0, 16.0)),
        "at_x": ("real", (0.0, 5.0)),
        "at_y": ("real", (0.0, 5.0)),
        "at_z": ("real", (0.0, 5.0)),
    }
    assert entries["height"]["doc"] == "The height"
    assert entries["kind"]["group"] == "Style"
    assert left_out == {"name": "a text", "twice": "computed from others"}


def test_values_are_written_in_the_language_of_the_program():
    entries, _ = customizer('a = 1; // [1:9]\nb = true;\nk = "x"; // [x, y]\nv = [1, 2]; // [0:0.5:4]')
    params = {"a": 3, "b": False, "k": "y", "v_x": 0.5, "v_y": 2.0}
    assert assignments(entries, params) == {"a": "3", "b": "false", "k": '"y"', "v": "[0.5, 2.0]"}


@pytest.mark.parametrize("head", ["OFF 5 2 0\n", "OFF\n5 2 0\n\n"])
def test_the_files_of_the_program_are_read(head):
    square = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n4 0 1 2 3 255 0 0\n3 0 1 4\n"
    vertices, faces = read_off(head + square)
    assert vertices.shape == (5, 3)
    np.testing.assert_array_equal(faces, [[0, 1, 2], [0, 2, 3], [0, 1, 4]])


def test_a_long_line_is_read_in_linear_time():
    start = time.monotonic()
    assert customizer("a =" + 1_000_000 * " ") == ({}, {})
    assert time.monotonic() - start < 5


@needs_openscad
@pytest.mark.parametrize("command", ["linear_extrude(height = width, file = name)", "rotate_extrude(name)"])
def test_a_drawing_that_is_read_without_a_command_for_it_is_refused(tmp_path, command):
    """No list of words finds it, because the path may be in any variable."""
    corners = [(0, 0), (9, 0), (9, 9), (0, 0)]
    lines = [f"0 LINE 8 0 10 {a} 20 {b} 11 {c} 21 {d}" for (a, b), (c, d) in pairwise(corners)]
    drawing = " ".join(["0 SECTION 2 ENTITIES", *lines, "0 ENDSEC 0 EOF"])
    (tmp_path / "other.dxf").write_text(drawing.replace(" ", "\n"))
    (tmp_path / "box.scad").write_text(f'width = 2; // [1:5]\nname = "{tmp_path}/other.dxf";\n{command};\n')
    with pytest.raises(ValueError, match=r"OpenSCAD says: DEPRECATED: Support for reading files in \w+_extrude"):
        import_scad(tmp_path / "box.scad", seconds=5.0)


@needs_openscad
@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("cube(1);", "no variable that the Customizer would show"),
        ("a = 2;\ninclude <nowhere.scad>\ncube(a);", "nowhere.scad"),
        ("a = 2;\ncube(a", "rror"),
        ("a = 2;\nfunction f(x) = f(x + 1);\ncube(f(a));", r"bad\.scad cannot be built"),
    ],
    ids=["no parameters", "missing include", "syntax", "endless recursion"],
)
def test_a_file_that_cannot_be_built_gets_a_sentence(text, sentence, tmp_path):
    (tmp_path / "bad.scad").write_text(text)
    with pytest.raises(ValueError, match=sentence):
        import_scad(tmp_path / "bad.scad", tmp_path / "made.toml")
    assert not (tmp_path / "made.toml").exists()


@needs_openscad
def test_an_openscad_file_goes_all_the_way_to_an_edited_asset(tmp_path):
    shutil.copy(EXAMPLE, tmp_path / "vase.scad")
    picture = np.zeros((96, 96, 4), np.uint8)
    picture[10:80, 30:60] = (120, 90, 60, 255)
    save_image(picture, tmp_path / "vase.png")
    for line in COMMANDS.strip().splitlines():
        words = [sys.executable, "-c", TRAIN, *shlex.split(line)[1:]]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, f"{line}: {done.stderr}"
    assert json.loads((tmp_path / "found.json").read_text())["generator"].endswith("vase.toml")
    assert (tmp_path / "taller.glb").stat().st_size > 1000
