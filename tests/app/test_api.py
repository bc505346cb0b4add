"""The app over HTTP: what programs get, and what strangers may send."""

import json
import struct
import urllib.error
import urllib.request
import zlib

import numpy as np
import pytest
import trimesh
from boxes import BOX, TRUTH
from gradio_client import Client, handle_file
from gradio_client.exceptions import AppError
from PIL import Image

from dipcg.app.limits import MOST_BODY_BYTES
from dipcg.images import MAX_PIXELS
from dipcg.inference.estimate import Options


@pytest.fixture(scope="module")
def client(address):
    return Client(address, verbose=False)


def test_a_program_gets_what_python_gets(client, studio, picture, tmp_path):
    found = client.predict(handle_file(picture), "box", 2, 0, {"width": 0.4}, api_name="/estimate")
    expected = studio.estimate(picture, Options(generator="box", candidates=2, fixed={"width": 0.4})).estimate
    assert [c["params"] for c in found["candidates"]] == [c.params for c in expected.candidates]
    assert (found["generators"], found["chances"]) == ({"box": 1.0}, found["probabilities"])
    assert found["candidates"][0]["agreement"] == pytest.approx(expected.candidates[0].agreement)
    best = found["candidates"][0]["params"]
    file = client.predict("box", best, ".glb", False, api_name="/build")
    assert trimesh.load(file).extents.max() > 0.2
    assert client.predict(api_name="/generators") == [{"name": "box", "parameters": BOX.describe()}]
    cut = Image.open(client.predict(handle_file(picture), None, api_name="/cut_out"))
    assert np.asarray(cut)[..., 3].min() == 0


def test_a_program_may_say_what_it_wants(client, studio):
    pytest.importorskip("transformers")
    found = client.predict("a low box with legs", "", 2, 0, {"width": 0.4}, api_name="/describe")
    options = Options(generator="box", candidates=2, fixed={"width": 0.4})
    expected = studio.describe("a low box with legs", options).estimate
    assert [c["params"] for c in found["candidates"]] == [c.params for c in expected.candidates]
    assert found["misfit"] is None


@pytest.mark.parametrize(
    ("words", "endpoint", "said"),
    [
        (["", "box", 2, 0, {}], "/describe", "The text is empty"),
        (["box", {"width": 99}, ".glb", False], "/build", "These parameters are missing"),
        (["box", TRUTH | {"width": 99}, ".glb", False], "/build", "width must be a number from 0.3 to 1 m, got 99."),
        (["box", TRUTH, ".exe", False], "/build", "There is no format '.exe'"),
        (["box", "all of them", ".glb", False], "/build", "Parameters are an object"),
        (["bax", TRUTH, ".glb", False], "/build", "Did you mean 'box'?"),
        (["../../etc/passwd", TRUTH, ".glb", False], "/build", "There is no generator"),
    ],
)
def test_what_a_program_asks_wrongly_is_answered_in_a_sentence(client, words, endpoint, said):
    with pytest.raises(AppError) as caught:
        client.predict(*words, api_name=endpoint)
    assert said in str(caught.value)
    assert "Traceback" not in str(caught.value)


def bomb(side: int) -> bytes:
    """A PNG of a few kilobytes that would fill memory."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    rows_of_zeros = zlib.compress(b"\0" * (side * (side // 8 + 1)), 9)
    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows_of_zeros) + chunk(b"IEND", b"")


def test_pictures_that_are_none_or_too_large_are_refused(client, tmp_path):
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "bomb.png").write_bytes(bomb(int(MAX_PIXELS**0.5) + 800))
    (tmp_path / "huge.png").write_bytes(bomb(20_000))
    for name, said in [("text", "not a picture"), ("bomb", "64 million"), ("huge", "64 million")]:
        with pytest.raises(AppError, match=said):
            client.predict(handle_file(tmp_path / f"{name}.png"), None, api_name="/cut_out")


def test_no_path_and_no_address_of_a_client_is_opened(client, picture, tmp_path):
    secret = tmp_path / "secret.png"
    secret.write_bytes(picture.read_bytes())
    for path in (str(secret), "/etc/passwd", "../../../etc/passwd", "file:///etc/passwd"):
        assert "it was not uploaded by a user" in posted(client, path), path
    assert "addresses are not fetched" in posted(client, "http://192.0.2.1/a.png")


def posted(client: Client, path: str) -> str:
    """What the server says to a picture of this path; the client of Gradio would upload the file."""
    data = json.dumps({"data": [{"path": path, "meta": {"_type": "gradio.FileData"}}, None]}).encode()
    address = f"{client.src}gradio_api/call/cut_out"
    request = urllib.request.Request(address, data, {"Content-Type": "application/json"})
    event = json.loads(urllib.request.urlopen(request, timeout=20).read())["event_id"]
    return urllib.request.urlopen(f"{address}/{event}", timeout=20).read().decode()


def test_a_request_that_is_too_large_is_not_read(client):
    request = urllib.request.Request(f"{client.src}gradio_api/queue/join", b"{}", {"Content-Type": "application/json"})
    request.add_unredirected_header("Content-Length", str(MOST_BODY_BYTES + 1))
    with pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(request, timeout=10)
    assert caught.value.code == 413
