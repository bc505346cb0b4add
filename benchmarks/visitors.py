"""Visitors of the web app: all at once first, then for a while, with a build worker killed in the middle.

`DIPCG_BENCH_VISITORS` and `DIPCG_BENCH_SECONDS` (20 and 120), `DIPCG_BENCH_CHECKPOINT` (chair) set the scale.
"""

import io
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from benchmarks.timing import header, machine, row
from dipcg.app.client import ApiError, Client

VISITORS = int(os.environ.get("DIPCG_BENCH_VISITORS", "20"))
SECONDS = float(os.environ.get("DIPCG_BENCH_SECONDS", "120"))
CHECKPOINT = os.environ.get("DIPCG_BENCH_CHECKPOINT", "chair")
EXAMPLES = Path(__file__).parent.parent / "examples/images"
PICTURES = [EXAMPLES / f"{name}.png" for name in ("armchair", "chair", "sketch")]
START_S = 300.0


@dataclass
class Seen:
    """What the visitors saw: seconds until each kind of answer, and what went wrong."""

    first: list[float] = field(default_factory=list)
    unranked: list[float] = field(default_factory=list)
    some: list[float] = field(default_factory=list)
    ranked: list[float] = field(default_factory=list)
    edits: list[float] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def main() -> None:
    print(machine() + f"; {VISITORS} visitors for {SECONDS:g} s\n")
    port = _free_port()
    command = [sys.executable, "-m", "dipcg.cli", "serve", CHECKPOINT, "--port", str(port)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as server:
        try:
            # Everything is warm after this.
            _visit(_connect(port), 0, Seen())
            together, seen = _all_at_once(port), Seen()
            memory = _serve_visitors(server.pid, port, seen)
        finally:
            server.send_signal(signal.SIGINT)
    _report("All at once, each a single time", together)
    _report("One visit after another", seen)
    problems = together.problems + seen.problems
    print(f"\nErrors or lost results: {len(problems)}, with one build worker killed half-way.")
    print(f"Memory of server and workers, MB: {', '.join(f'{m:.0f}' for m in memory)}.")
    assert not problems, problems[0]


def _all_at_once(port: int) -> Seen:
    """Every visitor sends a picture in the same moment."""
    seen, clients = Seen(), [_connect(port) for _ in range(VISITORS)]
    with ThreadPoolExecutor(VISITORS) as pool:
        list(pool.map(lambda number: _try_to_visit(clients[number], number, seen), range(VISITORS)))
    return seen


def _serve_visitors(server: int, port: int, seen: Seen) -> list[float]:
    """Let all visitors work; memory of the server and its workers in MB, at ten moments."""
    until = time.monotonic() + SECONDS
    memory = []
    with ThreadPoolExecutor(VISITORS) as pool:
        visits = [pool.submit(_keep_visiting, port, number, until, seen) for number in range(VISITORS)]
        for tenth in range(10):
            time.sleep(max(0.0, until - SECONDS * (9 - tenth) / 10 - time.monotonic()))
            memory.append(_memory_mb(server))
            if tenth == 4:
                _kill_a_worker(server)
    for visit in visits:
        visit.result()
    return memory


def _keep_visiting(port: int, number: int, until: float, seen: Seen) -> None:
    client = _connect(port)
    while time.monotonic() < until:
        _try_to_visit(client, number, seen)


def _try_to_visit(client: Client, number: int, seen: Seen) -> None:
    try:
        _visit(client, number, seen)
    except Exception as error:
        seen.problems.append(f"visitor {number}: {type(error).__name__}: {error}")


def _visit(client: Client, number: int, seen: Seen) -> None:
    """A picture to candidates, then one edit built in light detail, and the file opened."""
    started, answers = time.perf_counter(), []

    def watch(job: dict[str, Any]) -> None:
        if job["result"]:
            found = job["result"]
            answers.append((time.perf_counter() - started, found["ranked"], len(found["candidates"])))

    found = client.estimate(PICTURES[number % len(PICTURES)], watch, candidates=8, seed=number)
    seen.first.append(answers[0][0])
    seen.unranked.append(next(seconds for seconds, _, count in answers if count > 1))
    seen.some.append(next(seconds for seconds, is_ranked, _ in answers if is_ranked))
    seen.ranked.append(answers[-1][0])
    params = found["candidates"][-1]["params"]
    started = time.perf_counter()
    opened: Any = trimesh.load(io.BytesIO(client.preview(found["generator"], params)), file_type="glb")
    seen.edits.append(time.perf_counter() - started)
    assert len(opened.geometry) > 0


def _report(title: str, seen: Seen) -> None:
    print(f"\n{title}\n")
    header("what", "answers", "median s", "95 % s", "last s")
    rows = {
        "picture to the expected candidate": seen.first,
        "picture to 8 candidates, unranked": seen.unranked,
        "picture to the likeliest candidates, ranked": seen.some,
        "picture to 8 candidates, ranked": seen.ranked,
        "parameters to a light GLB": seen.edits,
    }
    for what, taken in rows.items():
        row(what, len(taken), *(f"{np.percentile(taken, share):.2f}" for share in (50, 95, 100)))


def _kill_a_worker(server: int) -> None:
    workers = [pid for pid in _descendants(server) if "dipcg.workers.child" in _file(pid, "cmdline")]
    os.kill(workers[0], signal.SIGKILL)


def _memory_mb(server: int) -> float:
    pages = [_file(pid, "statm").split() for pid in (server, *_descendants(server))]
    return sum(int(found[1]) for found in pages if found) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _descendants(pid: int) -> list[int]:
    children = [int(child) for task in Path(f"/proc/{pid}/task").glob("*") for child in _words(task / "children")]
    return children + [below for child in children for below in _descendants(child)]


def _words(path: Path) -> list[str]:
    try:
        return path.read_text().split()
    # The thread may have ended meanwhile.
    except OSError:
        return []


def _file(pid: int, name: str) -> str:
    try:
        return Path(f"/proc/{pid}/{name}").read_text()
    except OSError:
        return ""


def _connect(port: int) -> Client:
    until = time.monotonic() + START_S
    while True:
        try:
            client = Client(f"http://127.0.0.1:{port}")
            client.about()
            return client
        except ApiError:
            if time.monotonic() > until:
                raise
            time.sleep(1)


def _free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


if __name__ == "__main__":
    main()
