"""Anything at all is sent to every route of the API: what comes back is an answer, or one sentence."""

import io
import json
import os
import urllib.error
import urllib.request
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from boxes import BOX, TRUTH
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from dipcg.app.client import ApiError, Client
from dipcg.app.models import AssetRequest, Corrections, EstimateRequest, PreviewRequest

# Requests of all tests of this file together, about.
CASES = int(os.environ.get("DIPCG_FUZZ_CASES", "300"))
FEW = settings(max_examples=max(5, CASES // 25), suppress_health_check=list(HealthCheck))
MANY = settings(max_examples=max(5, CASES * 2 // 13), suppress_health_check=list(HealthCheck))

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inside: st.lists(inside, max_size=3) | st.dictionaries(st.text(max_size=8), inside, max_size=3),
    max_leaves=6,
)
PARAMS = st.fixed_dictionaries({}, optional={name: JSON | st.just(TRUTH[name]) for name in BOX.names})
# What stands in requests besides values of the right type.
LIKELY: dict[str, st.SearchStrategy] = {
    "generator": st.just("box"),
    "params": PARAMS | st.just(TRUTH),
    "fixed": PARAMS,
    "format": st.sampled_from([".json", ".glb", ".exe"]),
    "candidates": st.integers(1, 2),
    "picture": st.text(max_size=30),
    "text": st.text(max_size=40),
    "how": st.sampled_from(["auto", "by colour", "mask", "as it is"]),
    "foreground": st.just([{"points": [[0.5, 0.5]], "radius": 0.1}]),
    "crop": st.fixed_dictionaries({"left": st.floats(-1, 2), "top": st.floats(0, 1)}),
}


def bodies(model: Any) -> st.SearchStrategy:
    """Requests that are nearly right: each field is missing, likely, or anything."""
    fields = {name: LIKELY.get(name, st.nothing()) | JSON for name in model.model_fields}
    likely = st.fixed_dictionaries({}, optional={n: s for n, s in LIKELY.items() if n in model.model_fields})
    return st.fixed_dictionaries({}, optional=fields) | likely | JSON


@pytest.fixture(scope="module")
def client(address) -> Client:
    return Client(address, timeout_s=120.0)


@pytest.fixture(scope="module")
def picture_id(client, picture) -> str:
    return client.upload(picture)


def answered(client: Client, method: str, path: str, body: bytes | None, kind: str = "application/json") -> Any:
    """The answer of a request, or None where it is refused in a sentence."""
    try:
        return client.send(method, path, body, kind)
    except ApiError as refused:
        error = refused
    assert 400 <= error.status < 500 or error.status == 503
    assert len(str(error)) > 10
    assert str(error)[-1] in ".?"
    return None


def finished(client: Client, accepted: Any) -> Any:
    """The result of the job that was accepted, or None where it failed in a sentence."""
    if accepted is None:
        return None
    try:
        return client.finish(json.loads(accepted)["job"])
    except ApiError as failed:
        error = failed
    assert "went wrong" not in str(error)
    return None


@pytest.mark.slow
@FEW
@given(body=bodies(EstimateRequest))
def test_estimates(client, picture_id, body):
    if isinstance(body, dict) and "text" not in body:
        body |= {"picture": picture_id, "candidates": 1}
    found = finished(client, answered(client, "POST", "/estimates", as_json(body)))
    if found and found["generator"] == "box":
        BOX.validate(found["candidates"][0]["params"])


@FEW
@given(body=bodies(AssetRequest))
def test_assets(client, body):
    made = finished(client, answered(client, "POST", "/assets", as_json(body)))
    assert made is None or made["bytes"] > 0


@MANY
@given(body=bodies(PreviewRequest))
def test_previews(client, body):
    made = answered(client, "POST", "/assets/preview", as_json(body))
    assert made is None or made[:4] == b"glTF"


@MANY
@given(body=bodies(Corrections))
def test_cut_outs(client, picture_id, body):
    answered(client, "POST", f"/pictures/{picture_id}/object", as_json(body))


ROUTES = ["jobs/{}", "jobs/{}/events", "pictures/{}", "files/{}/{}", "generators/{}/random", "examples/{}", "{}"]


@MANY
@given(
    method=st.sampled_from(["GET", "POST", "DELETE", "PUT", "PATCH", "OPTIONS", "HEAD"]),
    route=st.sampled_from(ROUTES),
    names=st.lists(st.text(max_size=20), min_size=2, max_size=2),
    query=st.dictionaries(st.sampled_from(["seed", "x"]), st.text(max_size=5), max_size=2),
)
def test_addresses(client, method, route, names, query):
    path = route.format(*(quote(name, safe="") for name in names))
    words = "&".join(f"{name}={quote(value)}" for name, value in query.items())
    request = urllib.request.Request(f"{client.url}/api/v1/{path}?{words}", method=method)
    status = 200
    try:
        urllib.request.urlopen(request, timeout=60).read()
    except urllib.error.HTTPError as error:
        status = error.code
    assert status < 500


@MANY
@given(content=st.binary(max_size=300))
def test_bodies_that_are_no_json(client, content):
    for path in ("/estimates", "/assets", "/assets/preview"):
        answered(client, "POST", path, content)


@st.composite
def pictures(draw: st.DrawFn) -> bytes:
    """Real picture files, some of them damaged, and bytes that are none."""
    height, width = draw(st.integers(1, 90)), draw(st.integers(1, 90))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pixels = rng.integers(0, 256, (height, width, 4)).astype(np.uint8)
    mode = draw(st.sampled_from(["RGBA", "RGB", "L", "1", "P", "LA", "CMYK", "I", "F"]))
    kind = draw(st.sampled_from(["PNG", "JPEG", "WEBP", "GIF", "BMP", "TIFF", "AVIF"]))
    file = io.BytesIO()
    try:
        Image.fromarray(pixels).convert(mode).save(file, kind)
    except (OSError, ValueError):
        # Not every format has every mode.
        Image.fromarray(pixels).save(file, "PNG")
    content = bytearray(file.getvalue())
    for place in draw(st.lists(st.integers(0, len(content) - 1), max_size=3)):
        content[place] = draw(st.integers(0, 255))
    return bytes(content[: draw(st.sampled_from([len(content), len(content), len(content) // 2]))])


@MANY
@given(content=pictures() | st.binary(max_size=200))
def test_pictures(client, content):
    answer = answered(client, "POST", "/pictures", content, "image/png")
    if answer is not None:
        name = json.loads(answer)["id"]
        assert Image.open(io.BytesIO(client.picture(name))).mode == "RGBA"
        answered(client, "POST", f"/pictures/{name}/object", b"{}")


def test_deep_json_is_refused(client):
    for deep in (b"[" * 200_000, b'{"a":' * 50_000, b"9" * 100_000):
        assert answered(client, "POST", "/estimates", deep) is None


def as_json(body: Any) -> bytes:
    return json.dumps(body).encode()
