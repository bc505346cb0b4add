"""Builds in child processes: kept warm, replaced before they slow down, stopped when they hang.

Blender only ever runs in these. A child is `python -m dipcg.workers.pool`, not a fork of the caller: no `__main__` guard is
needed in the caller's script, and neither torch nor an OpenGL context is carried along.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.connection import Connection, Pipe
from tempfile import TemporaryDirectory
from typing import Any

from dipcg.generators import Detail, load_generator
from dipcg.mesh import Mesh, MeshError
from dipcg.space import Params

START_TIMEOUT_S = 120.0
AHEAD = 4  # builds per worker that `map` keeps waiting or done, so that no worker idles
MOST_LETTERS = 500  # of what a generator says when it fails
PR_SET_PDEATHSIG = 1  # from linux/prctl.h


class BuildError(RuntimeError):
    """One sample could not be built; `reason` is one of raised, unusable (the mesh), timeout, crashed, start."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


Progress = Callable[[float, str], None]  # the share that is done, and what is done next
Timed = tuple[Mesh | BuildError, float | None]  # what became of one sample, and the seconds that its worker took


class BuildPool:
    """`workers` child processes that build meshes of one generator; use as a context manager.

    A build that takes longer than `timeout_s` costs that sample alone. Processes start at first use.
    Raises LookupError for an unknown generator and ModuleNotFoundError when a package it needs is not installed.
    """

    def __init__(self, generator: str, workers: int = 1, timeout_s: float = 60.0) -> None:
        self.generator = load_generator(generator)
        self.generator.check_installed()
        self.timeout_s = timeout_s
        self._local = threading.local()
        self._children: set[Child] = set()
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="build")
        self._workers = workers

    def build(self, params: Params, detail: Detail = "full") -> Mesh:
        """Build one mesh; raises BuildError with a sentence and the parameters as `dipcg edit` reads them."""
        return self.submit(params, detail).result()

    def submit(self, params: Params, detail: Detail = "full") -> Future[Mesh]:
        """Start one build; the future's result is the mesh or a BuildError."""
        return self._threads.submit(lambda: self._build(params, detail)[0])

    def map(self, many: Iterable[Params], detail: Detail = "light") -> Iterator[Mesh | BuildError]:
        """Build many in parallel, in order; a failed one gives its error in its place.

        Only a few are read and built ahead of what has been taken, so `many` may be endless.
        """
        return (outcome for outcome, _ in self.timed(many, detail))

    def timed(self, many: Iterable[Params], detail: Detail = "light") -> Iterator[Timed]:
        """As `map`, each with the seconds that its worker took, None for a failed one."""
        ahead: deque[Future[tuple[Mesh, float]]] = deque()
        for params in many:
            ahead.append(self._threads.submit(self._build, params, detail))
            if len(ahead) > AHEAD * self._workers:
                yield _outcome(ahead.popleft())
        while ahead:
            yield _outcome(ahead.popleft())

    def warm(self) -> None:
        """Start every worker in the background, so that the first build need not wait."""
        for _ in range(self._workers):
            self._threads.submit(self._child)

    def close(self) -> None:
        """Stop all workers at once."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for child in list(self._children):
            child.stop()
        self._threads.shutdown(wait=True)
        for child in list(self._children):  # one may have been started meanwhile
            child.stop()

    def __enter__(self) -> BuildPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _build(self, params: Params, detail: Detail) -> tuple[Mesh, float]:
        child = self._child()
        try:
            child.start()
            started = time.perf_counter()
            mesh = child.ask((params, detail), self.timeout_s)
            seconds = time.perf_counter() - started
        except BuildError as error:
            if error.reason not in ("raised", "unusable"):
                self._discard(child)
            asked = json.dumps({"generator": self.generator.ref, "params": params}, default=str)
            raise BuildError(error.reason, f"{error} `dipcg edit` builds it again from a file with: {asked}") from None
        if child.builds >= self.generator.recycle_after:
            self._discard(child)
        return mesh, seconds

    def _child(self) -> Child:
        if getattr(self._local, "child", None) is None:
            self._local.child = Child(self.generator.ref)
            self._children.add(self._local.child)
        return self._local.child

    def _discard(self, child: Child) -> None:
        child.stop()
        self._children.discard(child)
        self._local.child = None


class Child:
    """One process, which runs a module of ours, and the pipe to it; used by one thread."""

    def __init__(self, ref: str, module: str = "dipcg.workers.pool") -> None:
        self.builds = 0
        self._ready = False
        self._folder = TemporaryDirectory(prefix="dipcg-", ignore_cleanup_errors=True)  # Blender leaves its own behind
        self._pipe, theirs = Pipe()
        with theirs:
            command = [sys.executable, "-m", module, str(theirs.fileno()), ref]
            self._process = subprocess.Popen(
                command,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"TMPDIR": self._folder.name},
                start_new_session=True,  # Ctrl-C in the terminal reaches the caller alone, who then stops us
            )

    def start(self) -> None:
        if not self._ready:
            self._receive(START_TIMEOUT_S, "start")
            self._ready = True

    def ask(self, request: Any, timeout_s: float, progress: Progress | None = None) -> Any:
        """The answer to a request; raises BuildError when it takes longer, counted from the last word of progress."""
        self._send(request)
        self.builds += 1
        return self._receive(timeout_s, "timeout", progress)

    def stop(self) -> None:
        self._process.kill()
        self._process.wait()
        self._pipe.close()
        self._folder.cleanup()

    def _send(self, message: Any) -> None:
        with contextlib.suppress(OSError):  # a dead child is noticed when its answer is awaited
            self._pipe.send(message)

    def _receive(self, timeout_s: float, late: str, progress: Progress | None = None) -> Any:
        try:
            if not self._pipe.poll(timeout_s):
                what = "worker did not start within" if late == "start" else "build took longer than"
                raise BuildError(late, f"The {what} {timeout_s:g} s and was stopped.")
            kind, value = self._pipe.recv()
        except (EOFError, OSError):
            raise BuildError("crashed", f"The worker process died (exit code {self._exit_code()}).") from None
        if kind == "progress":
            if progress:
                progress(*value)
            return self._receive(timeout_s, late, progress)
        if kind in ("ready", "done"):
            return value
        raise BuildError("start" if late == "start" else kind, value)

    def _exit_code(self) -> int:
        try:
            return self._process.wait(timeout=1)
        except subprocess.TimeoutExpired:  # it closed the pipe and lives on
            self._process.kill()
            return self._process.wait()


def _outcome(future: Future[tuple[Mesh, float]]) -> Timed:
    try:
        return future.result()
    except BuildError as error:
        return error, None


def die_with_parent() -> None:
    """Ask Linux to kill this process when the caller goes, however it goes and whatever is being built by then.

    Elsewhere the closed pipe ends the process, after the build it is in.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _serve(pipe: Connection, ref: str) -> None:
    """The child's loop: prepare the generator once, then answer each (params, detail) with a mesh or a sentence."""
    try:
        generator = load_generator(ref)
        generator.prepare()
    except Exception as error:
        return pipe.send(("start", f"The generator could not be loaded, {told(error)}."))
    pipe.send(("ready", None))
    while True:
        params, detail = pipe.recv()
        try:
            answer = ("done", generator.build(params, detail))
        except MeshError as error:
            answer = ("unusable", str(error))
        except Exception as error:
            answer = ("raised", f"The generator raised {told(error)}.")
        pipe.send(answer)


def told(error: Exception) -> str:
    """The kind and the words of an error in one line of bearable length."""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:MOST_LETTERS]}".rstrip(".: ")


if __name__ == "__main__":
    die_with_parent()
    with contextlib.suppress(EOFError, BrokenPipeError, KeyboardInterrupt):
        _serve(Connection(int(sys.argv[1])), sys.argv[2])
    os._exit(0)  # Blender's own shutdown is slow and sometimes crashes
