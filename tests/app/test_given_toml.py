"""A TOML file that is sent before its Blender file: its ranges are taken, edited and learned."""

from importlib.util import find_spec
from pathlib import Path

import pytest
from serving import serving
from test_trainings import last, stand_in

from dipcg.app.client import ApiError, Client

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.blender
@pytest.mark.skipif(find_spec("bpy") is None, reason="bpy not installed")
def test_a_lamp_is_learned_as_its_toml_file_says(studio, tmp_path, monkeypatch) -> None:
    stand_in(monkeypatch)
    text = (EXAMPLES / "lamp.toml").read_text().replace("[parameters.base_radius]", "[parameters.foot]")
    with serving(studio, tmp_path / "served", learn=tmp_path / "learned") as address:
        client = Client(address)
        sent = client.propose(EXAMPLES / "lamp.blend", toml=text.encode())
        found = last(client, sent["id"])
        assert (found["error"], found["object"]) == (None, "Lamp")
        parameters = {p["name"]: p for p in found["parameters"]}
        assert "base_radius" not in parameters
        assert (parameters["foot"]["low"], parameters["foot"]["high"]) == (0.08, 0.14)
        assert len(found["samples"]) == 6
        with pytest.raises(ApiError, match="The source limits foot to"):
            client.set_ranges(found["id"], {"foot": (0.01, 0.14)})
        client.learn(found["id"], shapes=40, minutes=0.1)
        assert last(client, found["id"])["state"] == "done"
        learned = next(g for g in client.generators() if g["name"] == found["name"])
        assert {p["name"]: p["input"] for p in learned["parameters"]}["foot"] == "Socket_17"
    studio.forget(found["name"])
