"""A client of the API in plain Python: what a script, a test or an add-on needs.

>>> client = Client("http://127.0.0.1:7860")
>>> estimate = client.estimate("photo.png")
>>> best = estimate["candidates"][0]["params"]
>>> client.build(estimate["generator"], best | {"width": 0.6}, "chair.glb")
"""

from __future__ import annotations

import contextlib
import json
import urllib.error
import urllib.request
from collections.abc import Callable, Iterable, Iterator, Mapping
from http.client import HTTPException
from pathlib import Path
from typing import Any
from urllib.parse import quote

Answer = dict[str, Any]
# Called with each change of a job, as `GET /api/v1/jobs/{id}` gives it.
Report = Callable[[Answer], None]


class ApiError(RuntimeError):
    """The server refused a request, or a job failed; the message is the server's sentence, `status` its number."""

    def __init__(self, sentence: str, status: int = 0) -> None:
        super().__init__(sentence)
        self.status = status


class Client:
    """A server at an address. It needs nothing but Python, and every method raises ApiError with a sentence."""

    def __init__(self, url: str = "http://127.0.0.1:7860", timeout_s: float = 600.0) -> None:
        self.url, self.timeout_s = url.rstrip("/"), timeout_s
        # No proxy of the environment, since the server is usually this machine.
        self._open = urllib.request.build_opener(urllib.request.ProxyHandler({})).open

    def about(self) -> Answer:
        """Version, formats, limits and examples of the server."""
        return self._json("GET", "/about")

    def generators(self) -> list[Answer]:
        """The generators with their parameters."""
        return self._json("GET", "/generators")

    def random(self, generator: str, seed: int | None = None) -> Answer:
        """Random parameters of a generator."""
        query = "" if seed is None else f"?seed={seed}"
        return self._json("GET", f"/generators/{quote(generator)}/random{query}")["params"]

    def upload(self, picture: str | Path | bytes) -> str:
        """Send a picture, from a file or as bytes; returns its id."""
        return self._parsed(self.send("POST", "/pictures", _bytes(picture), "image/*"))["id"]

    def cut_out(self, picture: str, **corrections: Any) -> Answer:
        """Cut the object out of an uploaded picture; `corrections` are those of the API."""
        return self._json("POST", f"/pictures/{picture}/object", corrections)

    def picture(self, picture: str) -> bytes:
        """An uploaded picture or a cut-out as PNG."""
        return self.send("GET", f"/pictures/{picture}")

    def forget(self, picture: str) -> None:
        """Delete an uploaded picture."""
        self.send("DELETE", f"/pictures/{picture}")

    def estimate(self, picture: str | Path | bytes, report: Report | None = None, **options: Any) -> Answer:
        """Upload a picture and estimate; `options` are those of the API: generator, candidates, seed, fixed, object."""
        return self.finish(self.start_estimate(self.upload(picture), **options), report)

    def describe(self, text: str, report: Report | None = None, **options: Any) -> Answer:
        """Estimate what a sentence describes."""
        return self.finish(self._json("POST", "/estimates", {"text": text, **options})["job"], report)

    def build(
        self, generator: str, params: Mapping[str, Any], path: str | Path, report: Report | None = None, **options: Any
    ) -> Path:
        """Build an asset and save it, in the format of the path's ending; `options`: detail, faces, texture, colours.

        An OBJ comes as an archive with its materials, so the file that was written is returned.
        """
        path = Path(path)
        made = self.finish(self.start_build(generator, params, path.suffix, **options), report)
        target = path.with_suffix(Path(made["name"]).suffix)
        target.write_bytes(self.file(made))
        return target

    def start_build(self, generator: str, params: Mapping[str, Any], format: str, **options: Any) -> str:
        """Start to build an asset; returns the id of the job."""
        wanted = {"generator": generator, "params": dict(params), "format": format, **options}
        return self._json("POST", "/assets", wanted)["job"]

    def file(self, made: Answer) -> bytes:
        """The file of a finished build."""
        return self.send("GET", made["file"].removeprefix("/api/v1"))

    def preview(self, generator: str, params: Mapping[str, Any]) -> bytes:
        """An asset in light detail as GLB, at once."""
        return self.send("POST", "/assets/preview", _as_json({"generator": generator, "params": dict(params)}))

    def start_estimate(self, picture: str, **options: Any) -> str:
        """Start an estimate from an uploaded picture; returns the id of the job."""
        return self._json("POST", "/estimates", {"picture": picture, **options})["job"]

    def job(self, job: str) -> Answer:
        """How far a job is."""
        return self._json("GET", f"/jobs/{job}")

    def cancel(self, job: str) -> None:
        """Cancel a job."""
        self.send("DELETE", f"/jobs/{job}")

    def follow(self, job: str) -> Iterator[Answer]:
        """The job after each change, until it is over."""
        return self._events(f"/jobs/{job}/events")

    def finish(self, job: str, report: Report | None = None) -> Answer:
        """Wait for the result of a job."""
        last: Answer = {}
        for last in self.follow(job):
            if report:
                report(last)
        if last.get("state") != "done":
            raise ApiError(last.get("error") or ("The job was cancelled." if last else self._other))
        return last["result"]

    def trainings(self) -> list[Answer]:
        """The generators that are learned, the oldest first."""
        return self._json("GET", "/trainings")

    def training(self, training: str) -> Answer:
        """How far a training is, with its parameters and their ranges."""
        return self._json("GET", f"/trainings/{training}")

    def propose(
        self,
        source: str | Path | bytes,
        file: str = "",
        object: str = "",
        modifier: str = "",
        toml: str | Path | bytes = b"",
    ) -> Answer:
        """Send a .blend, .scad or Python file, of which ranges are proposed; `file` is its name.

        `toml` is the file that `dipcg generators add` has written for a .blend; its names and ranges are then taken.
        """
        head, content = _bytes(toml), _bytes(source)
        given = {"file": file or Path(str(source)).name, "object": object, "modifier": modifier, "toml": len(head)}
        query = "&".join(f"{name}={quote(str(value))}" for name, value in given.items())
        return self._parsed(self.send("POST", f"/trainings?{query}", head + content, "application/octet-stream"))

    def set_ranges(self, training: str, ranges: Mapping[str, Any], hold: Iterable[str] = ()) -> Answer:
        """Edit the proposed ranges, all at once: (low, high) by name, and names that stay as in the source."""
        return self._json("PUT", f"/trainings/{training}/ranges", {"ranges": dict(ranges), "hold": list(hold)})

    def learn(self, training: str, **options: Any) -> Answer:
        """Build data and train, or go on with it; `options`: shapes, minutes."""
        return self._json("POST", f"/trainings/{training}/learn", options)

    def stop_training(self, training: str) -> Answer:
        """Stop it, and keep what is there."""
        return self._json("POST", f"/trainings/{training}/stop", {})

    def delete_training(self, training: str) -> None:
        """Forget a generator and all that was learned."""
        self.send("DELETE", f"/trainings/{training}")

    def follow_training(self, training: str) -> Iterator[Answer]:
        """The training after each change, until nothing is done for it any more."""
        return self._events(f"/trainings/{training}/events")

    def send(self, method: str, path: str, body: bytes | None = None, kind: str = "application/json") -> bytes:
        """A request to a path below /api/v1, and the bytes of the answer."""
        with self._reading(), self._answer(method, path, body, kind) as answer:
            return answer.read()

    def _events(self, path: str) -> Iterator[Answer]:
        with self._reading(), self._answer("GET", path) as lines:
            for line in lines:
                if line.startswith(b"data:"):
                    yield self._parsed(line[5:])

    def _json(self, method: str, path: str, body: Any = None) -> Any:
        return self._parsed(self.send(method, path, None if body is None else _as_json(body)))

    def _parsed(self, answer: bytes) -> Any:
        try:
            return json.loads(answer)
        except ValueError:
            raise ApiError(self._other) from None

    @property
    def _other(self) -> str:
        return f"What answers at {self.url} is no dipcg server; start one with `dipcg serve`."

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        """A connection that breaks is an ApiError, at whatever point it breaks."""
        try:
            yield
        except (OSError, HTTPException) as error:
            reason = getattr(error, "reason", error)
            sentence = f"There is no answer from {self.url} ({reason}); start the server with `dipcg serve`."
            raise ApiError(sentence) from None

    def _answer(self, method: str, path: str, body: bytes | None = None, kind: str = "application/json") -> Any:
        headers = {"Content-Type": kind} if body is not None else {}
        request = urllib.request.Request(f"{self.url}/api/v1{path}", body, headers, method=method)
        try:
            return self._open(request, timeout=self.timeout_s)
        except urllib.error.HTTPError as error:
            raise ApiError(_sentence(error), error.code) from None


def _bytes(file: str | Path | bytes) -> bytes:
    return file if isinstance(file, bytes) else Path(file).read_bytes()


def _as_json(body: Any) -> bytes:
    return json.dumps(body).encode()


def _sentence(error: urllib.error.HTTPError) -> str:
    try:
        return str(json.load(error)["error"])
    except (ValueError, KeyError, TypeError):
        return f"The server answered with {error.code}."
