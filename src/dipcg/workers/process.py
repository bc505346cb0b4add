"""A child process and the pipe to it: started, asked within a time limit, stopped."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable
from multiprocessing.connection import Pipe
from tempfile import TemporaryDirectory
from typing import Any

START_TIMEOUT_S = 120.0


Progress = Callable[[float, str], None]  # the share that is done, and what is done next


class BuildError(RuntimeError):
    """One sample could not be built; `reason` is one of raised, unusable (the mesh), timeout, crashed, start."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


class Child:
    """One process, which runs `dipcg.workers.child`, and the pipe to it; used by one thread."""

    def __init__(self, ref: str, kind: str = "build") -> None:
        self.builds = 0
        self._ready = False
        self._folder = TemporaryDirectory(prefix="dipcg-", ignore_cleanup_errors=True)  # Blender leaves its own behind
        self._pipe, theirs = Pipe()
        with theirs:
            command = [sys.executable, "-m", "dipcg.workers.child", kind, str(theirs.fileno()), ref]
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
