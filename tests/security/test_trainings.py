"""Generators of strangers: nothing is learned unless the server says so, and then no file runs code or reads others."""

import contextlib
import json
import time

import pytest
from attacking import head, sent
from serving import serving

from dipcg import registry
from dipcg.app import training_queue, trainings
from dipcg.app.client import ApiError, Client
from dipcg.app.limits import MOST_SCAD_BYTES, MOST_SOURCE_BYTES
from dipcg.app.sources import check_source
from dipcg.importing.program import allow_program

PYTHON = b"import random\ndef make(seed): return random.Random(seed).random()\n"
BLENDER, BLENDER_5 = b"BLENDER-v402", b"BLENDER17-01v0501"


def test_a_server_learns_nothing_unless_it_was_told_to(address):
    client = Client(address)
    for name in ("lamp.blend", "box.scad", "box.py"):
        with pytest.raises(ApiError, match=r"dipcg serve --learn FOLDER"):
            client.propose(BLENDER, name)
    assert client.trainings() == []
    assert client.about()["learns"] is False


def test_python_is_refused_and_leaves_nothing(learning, folder):
    with pytest.raises(ApiError, match="--allow-code FOLDER"):
        learning.propose(PYTHON, "tower.py")
    assert learning.about()["takes_code"] is False
    assert list(folder.iterdir()) == []


def test_python_is_taken_where_its_folder_was_allowed(learning, folder, monkeypatch):
    monkeypatch.setattr(registry, "_allowed", set())
    registry.allow_code(folder)
    assert learning.propose(PYTHON, "tower.py")["file"] == "tower.py"


def test_a_folder_beside_the_allowed_one_stays_refused(learning, folder, monkeypatch):
    monkeypatch.setattr(registry, "_allowed", set())
    registry.allow_code(folder.parent / "learn", folder / "a.py")
    with pytest.raises(ApiError, match="--allow-code FOLDER"):
        learning.propose(PYTHON, "tower.py")


READING = [
    "include </etc/passwd>",
    "use <../../secret.scad>",
    'import("/etc/passwd");',
    'a = "//"; surface(file = "/etc/passwd");',
    'a = "\\"//"; import("x.stl");',
    "/* harmless */ include\n<x>",
    'linear_extrude(1) import_dxf("x.dxf");',
    'a = dxf_dim(file = "x.dxf");',
    # For OpenSCAD a comment ends with a line feed alone, and a word begins behind a number.
    "// \r /* \ninclude <x>\n// \r */",
    '// \r " \ninclude <x>\n// \r "',
    "a = 1.5include <x>;",
    "a = 1.5e3use <x>;",
]


@pytest.mark.parametrize("text", READING)
def test_openscad_that_reads_other_files_is_refused(learning, folder, text):
    with pytest.raises(ApiError, match="it must stand alone"):
        learning.propose(f"width = 2;\n{text}\ncube(width);".encode(), "box.scad")
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("end", ['b = "', "/* ", 'b = "\\'])
def test_openscad_that_would_go_on_in_our_settings_is_refused(tmp_path, end):
    """Behind the file OpenSCAD gets the values of parameters; an option from a comment would close it and be run."""
    path = tmp_path / "box.scad"
    path.write_text(f'a = "x"; // [x, ;include</etc/passwd>//, */include</etc/passwd>]\ncube(1);\n{end}')
    with pytest.raises(ValueError, match=r"box\.scad ends within a (text|comment); close it\."):
        check_source(path, "box.scad")


@pytest.mark.parametrize("part", ["/*", '"\\', "/", '"', "1"])
def test_openscad_of_a_stranger_is_searched_in_linear_time(tmp_path, part):
    """A search that goes back takes hours, in which the server answers nobody."""
    path = tmp_path / "box.scad"
    path.write_text(part * 400_000)
    start = time.monotonic()
    with contextlib.suppress(ValueError):
        check_source(path, "box.scad")
    assert time.monotonic() - start < 5


def test_openscad_has_a_limit(tmp_path):
    path = tmp_path / "box.scad"
    path.write_text("a" * (MOST_SCAD_BYTES + 1))
    with pytest.raises(ValueError, match=r"box\.scad has 4,194,305 bytes; an OpenSCAD file may have 4,194,304 here"):
        check_source(path, "box.scad")


def test_words_in_comments_and_strings_are_no_commands(tmp_path):
    path = tmp_path / "box.scad"
    path.write_text('// the surface, which we use\n/* import */ name = "include <x>"; cube(width);')
    check_source(path, "box.scad")


@pytest.mark.parametrize("start", ["1f8b08", "1f8b0800", "28b52ffd"])
def test_what_is_only_begun_like_a_compressed_file_is_refused(tmp_path, start):
    path = tmp_path / "lamp.blend"
    path.write_bytes(bytes.fromhex(start) + 7 * b"\0" + 99 * b"\xff")
    with pytest.raises(ValueError, match=r"lamp\.blend is not a Blender file"):
        check_source(path, "lamp.blend")


def test_a_file_of_a_newer_blender_is_refused_with_what_to_do(learning, folder):
    with pytest.raises(ApiError, match=r"clock\.blend was saved by Blender 5\.1.*--learn FOLDER --blender PROGRAM"):
        learning.propose(BLENDER_5, "clock.blend")
    assert list(folder.iterdir()) == []


def test_a_file_of_a_newer_blender_is_taken_where_there_is_one(studio, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(training_queue, "PROGRAM", "this")
    with serving(studio, tmp_path / "served", learn=folder, blender="/opt/blender") as address:
        assert Client(address).propose(BLENDER_5, "clock.blend")["file"] == "clock.blend"


def test_only_the_blender_of_the_server_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "_allowed", set())
    path = tmp_path / "lamp.toml"
    path.write_text('blender = "/tmp/evil"')
    for own in ("", "/opt/blender"):
        with pytest.raises(ValueError, match=r"lamp\.toml needs the Blender that it was made with"):
            allow_program(path, own)
    assert not registry.is_allowed(path)
    allow_program(path, "/tmp/evil")
    assert registry.is_allowed(path)


@pytest.mark.parametrize("name", ["lamp.blend", "a.toml", "a.so", "../../etc/cron.d/x", "blend", ""])
def test_what_is_no_source_is_refused_and_leaves_nothing(learning, folder, name):
    with pytest.raises(ApiError, match=r"not a Blender file|Give a Blender file"):
        learning.propose(b"#!/bin/sh\nrm -rf /\n", name)
    assert list(folder.iterdir()) == []


def test_the_name_of_a_file_leads_nowhere(learning, folder):
    made = learning.propose(BLENDER + b" and more", "../../..//x/" + "y" * 90 + "; rm -rf é.blend")
    stored = {path.parent for path in folder.rglob("*.blend")}
    assert stored == {folder / made["id"]}
    assert made["name"].isidentifier()
    assert len(made["name"]) <= 40


def test_a_source_has_a_limit_and_must_say_its_length(learning, folder):
    long = head("POST /api/v1/trainings?file=a.blend", {"Content-Length": str(MOST_SOURCE_BYTES + 1)})
    assert sent(learning.url, long).status == 413
    assert sent(learning.url, head("POST /api/v1/trainings", {"Transfer-Encoding": "chunked"})).status == 411
    assert list(folder.iterdir()) == []


def test_another_website_cannot_start_one(learning):
    asked = head("POST /api/v1/trainings?file=a.blend", {"Origin": "https://evil.example", "Content-Length": "0"})
    assert sent(learning.url, asked).status == 403


def test_no_more_are_kept_than_the_limit(learning, monkeypatch):
    monkeypatch.setattr(trainings, "MOST_TRAININGS", 2)
    for _ in range(2):
        learning.propose(BLENDER, "lamp.blend")
    with pytest.raises(ApiError, match="delete one first") as error:
        learning.propose(BLENDER, "lamp.blend")
    assert error.value.status == 503


@pytest.mark.parametrize("name", ["..", "%2e%2e", "x", "..%2fserved"])
def test_only_ids_name_a_training(learning, name):
    learning.propose(BLENDER, "lamp.blend")
    for method, path in (("GET", ""), ("DELETE", ""), ("GET", "/samples/0")):
        assert sent(learning.url, head(f"{method} /api/v1/trainings/{name}{path}", {})).status in (404, 405, 422)
    assert len(learning.trainings()) == 1


def test_wishes_have_limits(learning):
    training = learning.propose(BLENDER, "lamp.blend")["id"]
    for options in ({"shapes": 10**9}, {"minutes": 1e9}, {"minutes": float("nan")}, {"shapes": 0}, {"command": "x"}):
        with pytest.raises(ApiError) as error:
            learning.send("POST", f"/trainings/{training}/learn", json.dumps(options).encode())
        assert error.value.status == 422
