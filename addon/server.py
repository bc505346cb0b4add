"""What is asked of the server, in threads of their own. No thread touches Blender's data."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from .client import ApiError, Client

# Seconds until a request without an answer is given up, and between two looks at a job.
LIMIT_S, LOOK_S = 20.0, 0.3
HERE = ("127.0.0.1", "localhost", "::1")
CANCELLED = "Cancelled."


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
