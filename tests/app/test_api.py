"""The API: a program gets what Python gets, and every error is one sentence."""

import io
import json
import urllib.request

import numpy as np
import pytest
import trimesh
from boxes import BOX, TRUTH
from PIL import Image
from serving import serving
from stand_ins import broken, nothing, page, standing_in

from dipcg.app.client import ApiError, Client
from dipcg.inference.estimate import Options, describe, estimate
from dipcg.labels import label

ORDERED = Options(generator="box", candidates=2, fixed={"width": 0.4})


@pytest.fixture(scope="module")
def client(address) -> Client:
    return Client(address, timeout_s=60.0)


@pytest.mark.slow
def test_a_program_gets_what_python_gets(client, studio, picture):
    found = client.estimate(picture, generator="box", candidates=2, fixed={"width": 0.4})
    expected = estimate(picture, studio.inverters, ORDERED)
    assert [c["params"] for c in found["candidates"]] == [c.params for c in expected.estimate.candidates]
    assert found["candidates"][0]["agreement"] == pytest.approx(expected.estimate.candidates[0].agreement, abs=1e-6)
    assert (found["generators"], found["ranked"]) == ({"box": 1.0}, True)
    assert found["misfit"] == pytest.approx(expected.estimate.misfit, abs=1e-6)
    assert Image.open(io.BytesIO(client.picture(found["picture"]))).mode == "RGBA"


@pytest.mark.slow
def test_the_unranked_estimate_comes_first_and_more_candidates_follow(client, picture):
    seen: list = []
    last = client.estimate(picture, report=seen.append, candidates=8, seed=1)
    results = [job["result"] for job in seen if job["result"]]
    unranked = [result["candidates"] for result in results if not result["ranked"]]
    assert (len(unranked[0]), len(unranked[-1])) == (1, 8)
    assert all(c["agreement"] is None and c["thumbnail"] is None for c in unranked[-1])
    assert (results[-1], last["ranked"]) == (last, True)
    assert all(c["thumbnail"].startswith("data:image/webp") for c in last["candidates"])
    shares = [job["share"] for job in seen]
    assert (shares, seen[-1]["state"]) == (sorted(shares), "done")


def test_words_become_candidates(client, studio):
    pytest.importorskip("transformers")
    found = client.describe("a low box with legs", generator="box", candidates=2, fixed={"width": 0.4})
    expected = describe("a low box with legs", studio.text_inverters, ORDERED)
    assert [c["params"] for c in found["candidates"]] == [c.params for c in expected.estimate.candidates]
    assert (found["misfit"], found["picture"]) == (None, None)
    assert len({json.dumps(c["view"]) for c in found["candidates"]}) == 1, "all from one side"


@pytest.mark.parametrize("answer", [page, broken, nothing])
def test_a_server_that_is_none_of_ours_or_dies_is_a_sentence(answer):
    with standing_in(answer) as address:
        client = Client(address, timeout_s=5.0)
        for ask in (client.generators, lambda: client.upload(b"picture"), lambda: client.finish("job")):
            with pytest.raises(ApiError, match=r"(no dipcg server|There is no answer).*dipcg serve"):
                ask()


def test_generators_are_described_with_labels(client):
    (found,) = client.generators()
    assert [p["name"] for p in found["parameters"]] == BOX.names
    assert [p["label"] for p in found["parameters"]] == [label(p) for p in BOX]
    overhang = next(p for p in found["parameters"] if p["name"] == "overhang")
    assert (overhang["high"], overhang["unit"], overhang["when"]) == (0.15, "m", {"top": ["flat", "pyramid"]})
    assert BOX.validate(client.random("box", seed=3)) == client.random("box", seed=3)


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".ply", ".stl"])
def test_files_have_the_size_that_the_parameters_say(client, tmp_path, suffix):
    made = client.build("box", TRUTH, tmp_path / f"box{suffix}")
    assert trimesh.load(made).extents[0] == pytest.approx(TRUTH["width"] + 2 * TRUTH["overhang"], abs=1e-4)


def test_an_obj_comes_with_its_materials_and_parameters_as_edit_reads_them(client, tmp_path):
    assert client.build("box", TRUTH, tmp_path / "box.obj").suffix == ".zip"
    made = client.build("box", TRUTH, tmp_path / "box.json")
    assert json.loads(made.read_text()) == {"generator": "box", "params": TRUTH}


def test_a_file_has_the_colours_that_are_sent(client, tmp_path):
    red, blue = [0.9, 0.1, 0.1], [0.1, 0.1, 0.9]
    made = trimesh.load(client.build("box", TRUTH, tmp_path / "box.glb", colours={"lid": red, "body": blue}))
    colours = {name: part.visual.material.baseColorFactor for name, part in made.geometry.items()}
    assert colours["lid"][0] > 3 * colours["lid"][2]
    assert colours["body"][2] > 3 * colours["body"][0]
    text = client.build("box", TRUTH, tmp_path / "box.json", colours={"lid": red}).read_text()
    assert json.loads(text)["colours"] == {"lid": red}


def test_the_size_of_a_file_is_known_before_it_is_fetched(client, tmp_path):
    seen: list = []
    made = client.build("box", TRUTH, tmp_path / "box.glb", seen.append, faces=12)
    result = seen[-1]["result"]
    assert (result["bytes"], result["name"]) == (made.stat().st_size, "box.glb")
    assert result["triangles"] == sum(len(part.faces) for part in trimesh.load(made).geometry.values())


def test_files_are_written_where_the_system_has_removed_the_folder_for_them(studio, tmp_path):
    with serving(studio, tmp_path / "removed") as address:
        assert Client(address).build("box", TRUTH, tmp_path / "box.glb").is_file()


def test_a_preview_is_the_asset(client):
    loaded = trimesh.load(io.BytesIO(client.preview("box", TRUTH)), file_type="glb")
    assert loaded.extents[0] == pytest.approx(TRUTH["width"] + 2 * TRUTH["overhang"], abs=1e-4)


def test_a_cut_out_is_a_picture_that_stays_as_it_is(client, picture):
    cut = client.cut_out(client.upload(picture), how="by colour", difference=5)
    again = client.cut_out(cut["picture"]["id"])
    pixels = [np.array(Image.open(io.BytesIO(client.picture(c["picture"]["id"])))) for c in (cut, again)]
    np.testing.assert_array_equal(*pixels)
    assert client.finish(client.start_estimate(cut["picture"]["id"], candidates=1))["generator"] == "box"


def test_a_cancelled_job_ends(client, picture):
    job = client.start_estimate(client.upload(picture), candidates=32)
    client.cancel(job)
    with pytest.raises(ApiError, match="cancelled"):
        client.finish(job)


def test_what_is_forgotten_is_gone(client, picture):
    name = client.upload(picture)
    client.forget(name)
    for ask in (client.picture, client.start_estimate):
        with pytest.raises(ApiError, match="no such picture") as error:
            ask(name)
        assert error.value.status == 404


@pytest.mark.parametrize(
    ("path", "body", "status", "said"),
    [
        ("/estimates", {}, 422, "Give either a picture or a text"),
        ("/estimates", {"text": "a box", "generator": "bax"}, 404, "Did you mean 'box'?"),
        (
            "/estimates",
            {"text": "a box", "candidates": 99},
            422,
            "candidates: Input should be less than",
        ),
        ("/estimates", {"text": "a box", "generator": "box", "fixed": {"width": 9}}, 422, "width must be a number"),
        ("/estimates", {"text": "a box", "fixed": {"width": 0.5}}, 422, "only of a generator that is named"),
        ("/estimates", {"picture": "../../etc/passwd"}, 422, "picture: String should match pattern"),
        ("/estimates", {"text": "a box", "path": "/etc/passwd"}, 422, "path: Extra inputs are not permitted"),
        ("/assets", {"generator": "box", "params": {"width": 99}}, 422, "These parameters are missing"),
        ("/assets", {"generator": "box", "params": TRUTH | {"width": 99}}, 422, "from 0.3 to 1 m, got 99"),
        ("/assets", {"generator": "box", "params": TRUTH, "format": ".exe"}, 422, "There is no format '.exe'"),
        ("/assets", {"generator": "box", "params": TRUTH, "format": ".obj", "texture": 64}, 422, "hold no maps"),
        ("/assets", {"generator": "box", "params": TRUTH, "colours": {"lid": [2, 0, 0]}}, 422, "less than or equal"),
        ("/assets", {"generator": "box", "params": "all"}, 422, "params: Input should be a valid dictionary"),
        ("/assets/preview", {"generator": "../../etc/passwd", "params": TRUTH}, 404, "There is no generator"),
    ],
)
def test_what_is_asked_wrongly_is_answered_in_a_sentence(client, path, body, status, said):
    with pytest.raises(ApiError) as error:
        client.send("POST", path, json.dumps(body).encode())
    assert said in str(error.value)
    assert (error.value.status, str(error.value)[-1] in ".?") == (status, True)


@pytest.mark.slow
def test_unusable_words_fail_the_job_with_a_sentence(client):
    pytest.importorskip("transformers")
    with pytest.raises(ApiError, match="The text"):
        client.describe("ein hölzerner Stuhl mit geschwungener Rückenlehne", generator="box")


def test_the_description_of_the_api_needs_nothing_from_elsewhere(address):
    page = urllib.request.urlopen(address + "/docs").read().decode()
    assert "//" not in page.replace("<!doctype html>", "")
    assert json.load(urllib.request.urlopen(address + "/openapi.json"))["paths"]["/api/v1/estimates"]
