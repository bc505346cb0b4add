"""What tests of the server's promises share: raw connections, and a server in a process of its own."""

import contextlib
import http.client
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from serving import box_checkpoint


def connect(address: str) -> socket.socket:
    """A connection to the server of an address."""
    host, port = address.removeprefix("http://").split(":")
    return socket.create_connection((host, int(port)), timeout=20)


def head(line: str, headers: dict[str, str], host: str = "127.0.0.1") -> bytes:
    """The first line of a request and its headers."""
    lines = [f"{line} HTTP/1.1", f"Host: {host}", *(f"{name}: {value}" for name, value in headers.items())]
    return "\r\n".join([*lines, "", ""]).encode()


@dataclass
class Answer:
    """A status, headers and a body; the status is 0 when the server closed the connection without an answer."""

    status: int
    headers: dict[str, str]
    body: str


def sent(address: str, content: bytes) -> Answer:
    """What the server answers to these bytes."""
    with connect(address) as line:
        line.sendall(content)
        return received(line)


def received(line: socket.socket) -> Answer:
    response = http.client.HTTPResponse(line)
    try:
        response.begin()
        headers = {name.lower(): value for name, value in response.getheaders()}
        return Answer(response.status, headers, response.read().decode("latin-1"))
    except (http.client.HTTPException, OSError):
        return Answer(0, {}, "")


@dataclass
class Process:
    """`dipcg serve` in a process of its own, whose temporary files lie in `folder`."""

    process: subprocess.Popen
    url: str
    folder: Path

    def memory(self, name: str) -> float:
        """A line of the process's status in MB: VmRSS is what it uses, VmHWM the most that it used."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(next(line for line in status.splitlines() if line.startswith(name)).split()[1]) / 1024

    def forget_peak(self) -> None:
        Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")

    def files(self) -> list[Path]:
        return [path for path in self.folder.rglob("*") if path.is_file()]


@contextlib.contextmanager
def started(folder: Path, *flags: str) -> Iterator[Process]:
    """A server of the toy generator."""
    checkpoint, port = box_checkpoint(folder / "checkpoint"), free_port()
    (folder / "temporary").mkdir()
    command = [sys.executable, "-m", "dipcg.cli", "serve", checkpoint, "--port", str(port), *flags]
    environment = os.environ | {"TMPDIR": str(folder / "temporary")}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    url = f"http://127.0.0.1:{port}"
    try:
        until = time.monotonic() + 120
        while True:
            try:
                urllib.request.urlopen(url + "/api/v1/about", timeout=5)
                break
            except OSError:
                assert process.poll() is None
                assert time.monotonic() < until
                time.sleep(0.1)
        yield Process(process, url, folder / "temporary")
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=30)


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]
