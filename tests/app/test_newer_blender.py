"""Files that are too new for our Blender: the server learns them with another, which `dipcg serve --blender` names."""

import os
import subprocess
import tomllib
from pathlib import Path

import pytest
from serving import serving
from test_trainings import last, stand_in

from dipcg.app.client import Client
from dipcg.app.server import learning_program

ROOT = Path(__file__).parents[2]
# A Python that has a newer bpy, as `make newer-blender` installs it.
NEWER = os.environ.get("DIPCG_NEWER_BLENDER", str(ROOT / ".newer-blender" / "bin" / "python"))
SAVE = """
import sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2])
"""


@pytest.mark.blender
@pytest.mark.skipif(not Path(NEWER).exists(), reason="no newer Blender; `make newer-blender` installs one")
def test_a_newer_file_is_learned_also_after_a_restart(studio, tmp_path, monkeypatch, picture) -> None:
    stand_in(monkeypatch)
    source, folder = tmp_path / "newer.blend", tmp_path / "learned"
    subprocess.run([NEWER, "-c", SAVE, ROOT / "examples" / "lamp.blend", source], check=True, capture_output=True)
    with serving(studio, tmp_path / "a", learn=folder, blender=NEWER) as address:
        client = Client(address)
        proposed = last(client, client.propose(source)["id"])
        assert proposed["error"] is None
        assert {"shade", "base_radius"} <= {p["name"] for p in proposed["parameters"]}
        assert len(proposed["samples"]) == 6
        assert tomllib.loads((folder / proposed["id"] / "newer.toml").read_text())["blender"] == NEWER
        client.learn(proposed["id"], shapes=40, minutes=0.1)
        assert last(client, proposed["id"])["state"] == "done"
        assert client.estimate(picture, generator="newer", candidates=1)["generator"] == "newer"
    studio.forget("newer")
    # Another Blender than the one that it was made with does not run.
    with serving(studio, tmp_path / "b", learn=folder) as address:
        assert "give that with --blender" in Client(address).trainings()[0]["error"]
        assert [g["name"] for g in Client(address).generators()] == ["box"]
    with serving(studio, tmp_path / "c", learn=folder, blender=NEWER) as address:
        assert Client(address).trainings()[0]["state"] == "done"
    studio.forget("newer")


@pytest.mark.parametrize(
    ("program", "learns", "words"),
    [
        ("/bin/true", True, r"is neither a Blender nor a Python that has bpy\."),
        ("no-such-blender", True, "There is no program no-such-blender"),
        ("/bin/true", False, "--learn FOLDER"),
    ],
)
def test_a_program_that_is_no_blender_does_not_start_a_server(tmp_path, program, learns, words) -> None:
    with pytest.raises(ValueError, match=words):
        learning_program(program, tmp_path if learns else None)
