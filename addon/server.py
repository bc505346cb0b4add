"""What is asked of the server, in threads of their own. No thread touches Blender's data."""

from __future__ import annotations

import contextlib
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from .client import ApiError, Client

# Seconds until a request without an answer is given up, and between two looks at a job.
LIMIT_S, LOOK_S = 20.0, 0.3
HERE = ("127.0.0.1", "localhost", "::1")
CANCELLED = "Cancelled."
# The states of a training in which something is done, or will be, and the seconds until a server that starts answers.
WORKING = ("waiting", "proposing", "learning", "stopping")
START_S = 180.0


@dataclass
class Estimated:
    """An estimate with the picture and its cut-out as PNG, both of one size."""

    result: dict[str, Any]
    picture: bytes
    cutout: bytes


class Task(threading.Thread):
    """Work beside Blender: `result` or the sentence `error` when the thread is over, `note` and `share` before."""

    def __init__(self, work: Callable[[Task], Any]) -> None:
        super().__init__(daemon=True)
        self._work = work
        self.stopped = threading.Event()
        self.result: Any = None
        self.error, self.note, self.share = "", "", 0.0
        self.start()

    def run(self) -> None:
        try:
            self.result = self._work(self)
        except ApiError as error:
            self.error = str(error)
        except Exception as error:
            # Whatever else answers at the port may send anything.
            self.error = f"The answer is not one of a dipcg server of this version ({type(error).__name__}: {error})."


def connect(address: str) -> Client:
    """A client of the server at an address of this machine; raises ApiError for any other."""
    if urlsplit(address).hostname not in HERE:
        raise ApiError(f"Pictures stay on this machine: use an address such as http://127.0.0.1:7860, got {address!r}.")
    return Client(address, LIMIT_S)


def generators(client: Client) -> list[dict[str, Any]]:
    """The generators that are served, with labels, parameters and the inputs that these set."""
    return [{key: g[key] for key in ("name", "label", "doc")} | _parameters(g) for g in client.generators()]


def trainings(client: Client) -> list[dict[str, Any]]:
    """The generators that are learned, with what the panel shows."""
    return [_training(training) for training in client.trainings()]


def found(task: Task, client: Client, command: list[str]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """The generators and the trainings of the server, which is started with `command` if nothing answers."""
    try:
        return generators(client), trainings(client)
    except ApiError as error:
        # Something that answers is another program, and stays.
        if not command or "no answer" not in str(error):
            raise
    task.note = "Starting the server"
    process = _start(command)
    until = time.monotonic() + START_S
    while time.monotonic() < until and process.poll() is None and not task.stopped.wait(LOOK_S):
        with contextlib.suppress(ApiError):
            return generators(client), trainings(client)
    raise ApiError(f"The server does not start; try `{' '.join(command)}` in a terminal to see why.")


def propose(task: Task, client: Client, source: bytes, file: str, object: str, modifier: str) -> dict[str, Any]:
    """Send a Blender file, and wait for the proposed ranges."""
    training = client.propose(source, file, object, modifier)["id"]
    try:
        return _succeeded(_settled(task, client, training))
    except ApiError:
        # Nobody would look at it again.
        client.delete_training(training)
        raise


def learn(
    task: Task, client: Client, training: str, ranges: dict[str, Any], hold: list[str], shapes: int, minutes: float
) -> dict[str, Any]:
    """Send the ranges if they are others than before, and begin or go on."""
    before = client.training(training)
    same = {p["name"]: [p["low"], p["high"]] for p in before["parameters"] if p["edited"]}
    if ranges != same or hold != [p["name"] for p in before["parameters"] if p["held"]]:
        client.set_ranges(training, ranges, hold)
        _succeeded(_settled(task, client, training))
    return _training(client.learn(training, shapes=shapes, minutes=minutes))


def stop(task: Task, client: Client, training: str) -> dict[str, Any]:
    """Stop a training, and wait until what is learned is kept."""
    client.stop_training(training)
    return _settled(task, client, training)


def watch(task: Task, client: Client, training: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Follow a training; returns it at its end, with the generators that are served then."""
    return _settled(task, client, training), generators(client)


def estimate(task: Task, client: Client, picture: bytes, generator: str, fixed: dict[str, Any]) -> Estimated:
    """Send a picture and wait for its candidates."""
    uploaded = client.upload(picture)
    job = client.start_estimate(uploaded, generator=generator, fixed=fixed)
    result = _finish(task, client, job)
    # These are what Blender will show, so they must be there.
    for candidate in result["candidates"]:
        _ = candidate["params"], candidate["view"]["azimuth_deg"], candidate["agreement"], candidate["thumbnail"]
    return Estimated(result, client.picture(uploaded), client.picture(result["picture"]))


def asset(task: Task, client: Client, generator: str, params: dict[str, Any]) -> bytes:
    """Let the server build an asset; returns it as GLB."""
    return client.file(_finish(task, client, client.start_build(generator, params, ".glb")))


def _parameters(generator: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    wanted = ("name", "label", "part", "unit", "options", "input", "component")
    return {"parameters": [{key: p[key] for key in wanted} for p in generator["parameters"]]}


def _training(training: dict[str, Any]) -> dict[str, Any]:
    """What is needed of a training; KeyError, TypeError or ValueError when another program has answered."""
    parameters = [
        {key: p[key] for key in ("name", "low", "high", "why", "held", "edited")} for p in training["parameters"]
    ]
    texts = {key: str(training[key]) for key in ("id", "state", "object", "note")}
    return texts | {"parameters": parameters, "share": float(training["share"]), "error": training["error"]}


def _settled(task: Task, client: Client, training: str) -> dict[str, Any]:
    """A training when nothing is done for it any more; ApiError when the task was stopped."""
    while True:
        now = _training(client.training(training))
        task.note, task.share = now["note"] or now["state"].capitalize(), now["share"]
        if now["state"] not in WORKING:
            return now
        if task.stopped.wait(LOOK_S):
            raise ApiError(CANCELLED)


def _succeeded(training: dict[str, Any]) -> dict[str, Any]:
    if training["error"]:
        raise ApiError(training["error"])
    return training


def _start(command: list[str]) -> subprocess.Popen:
    """Start the server so that it goes on when Blender ends."""
    nothing = subprocess.DEVNULL
    try:
        return subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True)
    except OSError as error:
        raise ApiError(f"{command[0]} cannot be started ({error.strerror}); correct it in the preferences.") from None


def _finish(task: Task, client: Client, job: str) -> dict[str, Any]:
    """Look at a job until it is over; raises ApiError when it failed or the task was stopped."""
    while True:
        now = client.job(job)
        task.note, task.share = str(now["note"]), float(now["share"])
        if now["state"] == "done":
            return now["result"]
        if now["state"] not in ("waiting", "running"):
            raise ApiError(now["error"] or CANCELLED)
        if task.stopped.wait(LOOK_S):
            client.cancel(job)
            raise ApiError(CANCELLED)
