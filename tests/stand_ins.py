"""Servers that stand in for ours, and answer wrongly."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from dipcg.app.client import Client

Answer = Callable[[BaseHTTPRequestHandler], bytes | None]


@contextlib.contextmanager
def standing_in(answer: Answer) -> Iterator[str]:
    """A server whose answers come from a function; None ends the connection without one."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.rfile.read(int(self.headers.get("content-length") or 0))
            if (body := answer(self)) is not None:
                self.send_response(200)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

        do_POST = do_GET

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


def page(_: BaseHTTPRequestHandler) -> bytes:
    return b"<html>Another program</html>"


def broken(request: BaseHTTPRequestHandler) -> None:
    """Half an answer."""
    request.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\ndata: [")


def nothing(_: BaseHTTPRequestHandler) -> None:
    """The connection ends without an answer."""


def other_api(_: BaseHTTPRequestHandler) -> bytes:
    return b'[{"hello": 1}]'


def dying(real: str, request: BaseHTTPRequestHandler) -> bytes | None:
    """As ours, until it is asked how far the job is."""
    if "/jobs/" in request.path:
        return None
    if request.path.endswith(("/generators", "/trainings")):
        return Client(real).send("GET", request.path.removeprefix("/api/v1"))
    return b'{"id": "picture", "job": "job"}'
