"""Generators that are learned: proposed, edited, learned, stopped, gone on with, and estimated with."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from serving import Quick, box_checkpoint, serving

from dipcg.app import training_queue
from dipcg.app.client import ApiError, Client
from dipcg.app.training_folder import NoTraining
from dipcg.app.trainings import Trainings

TESTS = Path(__file__).parents[1]
BLOCK = """
width = 40; // [20:60]
height = 30;
lid = "none"; // [none, flat]
lid_height = 5; // [2:10]
cube([width, 20, height]);
if (lid == "flat") translate([0, 0, height]) cube([width, 25, lid_height]);
"""

pytestmark = pytest.mark.skipif(shutil.which("openscad") is None, reason="openscad is not installed")


@pytest.fixture(scope="module")
def block(studio, tmp_path_factory) -> Path:
    """A folder with one training, whose ranges are proposed."""
    folder = tmp_path_factory.mktemp("block") / "learned"
    with pytest.MonkeyPatch.context() as patch, serving(studio, folder.parent, learn=folder) as address:
        stand_in(patch)
        training = client_of_block(Client(address))
        assert training["error"] is None
    return folder


@pytest.fixture
def folder(block, tmp_path, monkeypatch) -> Path:
    """Where trainings are kept; the process of these tests trains in seconds."""
    stand_in(monkeypatch)
    shutil.copytree(block, tmp_path / "learned")
    return tmp_path / "learned"


def stand_in(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(training_queue, "PROGRAM", "learning_stand_in")
    patch.setenv("PYTHONPATH", str(TESTS))


def client_of_block(client: Client) -> dict:
    """Send the block, and wait for its ranges."""
    return last(client, client.propose(BLOCK.encode(), "block.scad")["id"])


@pytest.fixture
def client(studio, folder, tmp_path) -> Iterator[Client]:
    with serving(studio, tmp_path / "served", learn=folder) as address:
        yield Client(address)
    for name in set(studio.names) - {"box"}:
        studio.forget(name)


def proposed(client: Client) -> dict:
    """The training that is there."""
    return client.trainings()[0]


def last(client: Client, training: str) -> dict:
    return list(client.follow_training(training))[-1]


def until(client: Client, training: str, share: float) -> None:
    """Wait until the training is so far."""
    assert any(now["share"] >= share for now in client.follow_training(training))


def test_a_source_is_proposed_edited_learned_and_estimated_with(client, picture) -> None:
    training = proposed(client)
    assert (training["state"], training["name"], training["error"]) == ("proposed", "block", None)
    found = {p["name"]: p for p in training["parameters"]}
    assert (found["width"]["low"], found["width"]["lowest"], found["height"]["lowest"]) == (20, 20, None)
    assert len(training["samples"]) == 6
    assert client.send("GET", training["samples"][0].removeprefix("/api/v1")).startswith(b"\x89PNG")
    client.set_ranges(training["id"], {"height": (25, 45)}, ["width"])
    edited = last(client, training["id"])
    assert [p["name"] for p in edited["parameters"] if p["held"]] == ["width"]
    assert edited["samples"] != training["samples"]
    client.learn(training["id"], shapes=40, minutes=0.1)
    states = list(client.follow_training(training["id"]))
    assert len({state["note"] for state in states if state["note"].startswith("Step")}) > 2
    assert sorted(state["share"] for state in states) == [state["share"] for state in states]
    assert states[-1]["state"] == "done"
    generator = next(g for g in client.generators() if g["name"] == "block")
    served = {p["name"]: p for p in generator["parameters"]}
    assert "width" not in served
    assert (served["height"]["low"], served["height"]["high"]) == (25, 45)
    assert client.estimate(picture, generator="block", candidates=2)["generator"] == "block"
    client.delete_training(training["id"])
    assert client.trainings() == []
    assert [g["name"] for g in client.generators()] == ["box"]


def test_a_stopped_training_goes_on_where_it_was(client, folder) -> None:
    training = proposed(client)["id"]
    client.learn(training, shapes=40, minutes=0.1)
    with pytest.raises(ApiError, match="stop it first"):
        client.set_ranges(training, {})
    until(client, training, 0.2)
    client.stop_training(training)
    assert last(client, training)["state"] == "stopped"
    steps = folder / training / "steps.txt"
    before = steps.read_text()
    client.learn(training, shapes=40, minutes=0.1)
    assert last(client, training)["state"] == "done"
    assert before
    assert [int(line) for line in steps.read_text().split()] == list(range(12))


def test_a_training_can_be_asked_for_while_its_samples_are_drawn_again(client, folder) -> None:
    training = proposed(client)
    shutil.rmtree(folder / training["id"] / "samples")
    assert proposed(client)["samples"] == []
    with pytest.raises(ApiError, match="no such sample"):
        client.send("GET", training["samples"][0].removeprefix("/api/v1"))
    (folder / training["id"] / "samples").mkdir()
    # A file that was listed, and is gone when it is looked at.
    (folder / training["id"] / "samples" / "0.png").symlink_to("gone.png")
    assert proposed(client)["samples"] == []


def test_what_is_asked_of_a_training_that_was_just_deleted_is_a_sentence(studio, folder) -> None:
    every = Trainings(studio, folder)
    training = every.all()[0]
    every.remove(training)
    changes = (lambda one: every.edit(one, {}, []), lambda one: every.learn(one, 1, 1.0))
    asked = (every.remove, every.stop, every.state, *changes)
    for ask in asked:
        with pytest.raises(NoTraining, match="There is no such training here"):
            ask(training)
    every.close()
    assert not training.folder.exists()


def test_a_training_goes_on_after_a_restart_of_the_server(tmp_path, folder, studio) -> None:
    with serving(studio, tmp_path / "a", learn=folder) as address:
        client = Client(address)
        training = proposed(client)["id"]
        client.learn(training, shapes=40, minutes=0.1)
        until(client, training, 0.2)
    steps = folder / training / "steps.txt"
    done = len(steps.read_text().split())
    assert 0 < done < 12
    with serving(studio, tmp_path / "b", learn=folder) as address:
        client = Client(address)
        assert client.training(training)["state"] in ("waiting", "learning")
        assert last(client, training)["state"] == "done"
    assert [int(line) for line in steps.read_text().split()] == list(range(12))
    studio.forget("block")
    # What is done is served again.
    with Quick([box_checkpoint(tmp_path / "box")], 1) as other, serving(other, tmp_path / "c", learn=folder) as address:
        assert [g["name"] for g in Client(address).generators()] == ["box", "block"]


def test_one_is_learned_at_a_time_and_names_differ(client) -> None:
    first, second = (client.propose(BLOCK.encode(), "Block.scad") for _ in range(2))
    assert [first["name"], second["name"]] == ["block_2", "block_3"]
    assert client.training(second["id"])["state"] == "waiting"
    client.stop_training(second["id"])
    client.stop_training(first["id"])
    assert {last(client, one["id"])["state"] for one in (first, second)} == {"stopped"}


@pytest.mark.parametrize(
    ("ranges", "hold", "words"),
    [
        ({"width": (10, 30)}, [], "The source limits width to 20 to 60"),
        ({"height": (30, 20)}, [], "must rise"),
        ({"heigth": (1, 2)}, [], "did you mean 'height'"),
        ({"lid": (1, 2)}, [], "has no range"),
        ({}, ["width", "height", "lid", "lid_height"], "Nothing would be left"),
    ],
)
def test_wrong_ranges_are_a_sentence_and_change_nothing(client, ranges, hold, words) -> None:
    training = proposed(client)
    with pytest.raises(ApiError, match=f"(?i){words}"):
        client.set_ranges(training["id"], ranges, hold)
    assert client.training(training["id"]) == training


def test_a_source_that_cannot_be_used_fails_with_a_sentence(client) -> None:
    found = last(client, client.propose(b"cube(1);", "block.scad")["id"])
    assert (found["state"], found["parameters"]) == ("failed", [])
    assert "no variable" in found["error"]
    with pytest.raises(ApiError, match="no proposed ranges"):
        client.learn(found["id"])


def test_a_process_that_dies_is_a_sentence(client, folder) -> None:
    training = proposed(client)["id"]
    client.learn(training, shapes=40, minutes=0.1)
    until(client, training, 0.1)
    next(one for one in psutil.Process().children() if "learning_stand_in" in one.cmdline()).kill()
    assert "ended by itself" in last(client, training)["error"]
    client.learn(training, shapes=40, minutes=0.1)
    assert last(client, training)["state"] == "done"


def test_a_process_that_ends_before_it_says_anything_is_an_error(client, monkeypatch):
    # A program that prints a poem and ends.
    monkeypatch.setattr(training_queue, "PROGRAM", "this")
    training = client_of_block(client)
    assert training["state"] == "failed"
    assert (training["share"], training["note"], training["error"]) == (0.0, "", training_queue.ENDED)
