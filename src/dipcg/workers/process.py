"""A child process and the pipe to it: start it, send it requests with a time limit, stop it."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Callable
from multiprocessing.connection import Pipe
from pathlib import Path
from typing import Any, Literal

from dipcg.blender.temporary import temporary_folder
from dipcg.space import Params

START_TIMEOUT_S = 120.0
# The file descriptor of the standard error of this process.
STDERR = 2
FOREIGN = Path(__file__).with_name("foreign.py")

# raised: the generator raised an error; unusable: its mesh cannot be used; start: the process did not start.
Reason = Literal["raised", "unusable", "timeout", "crashed", "start"]
# Called with the share of the work that is done, and with a note that says what is done next.
Progress = Callable[[float, str], None]


class BuildError(RuntimeError):
    """A mesh that could not be built: the message, the reason, the parameters, and the generator's name or file."""

    def __init__(self, reason: Reason, message: str, params: Params | None = None, generator: str = "") -> None:
        super().__init__(message)
        self.reason: Reason = reason
        self.params, self.generator = params, generator

    @property
    def hint(self) -> str:
        """A sentence that says how to build the same again from the command line; empty without parameters."""
        if self.params is None:
            return ""
        file = json.dumps({"generator": self.generator, "params": self.params}, default=str)
        return f"`dipcg edit` builds it again from a file with: {file}"


def _program(blender: str) -> list[str]:
    """The command line of a child up to its arguments."""
    if not blender:
        return [sys.executable, "-m", "dipcg.workers.child"]
    if "python" in Path(blender).name.lower():
        return [blender, str(FOREIGN)]
    return [blender, "--background", "--factory-startup", "--python-exit-code", "1", "--python", str(FOREIGN), "--"]


class Child:
    """One process that runs `dipcg.workers.child`, and the pipe to it; one thread uses it.

    `blender` is another Blender to run it in, or a Python that has Blender's module.
    """

    def __init__(self, ref: str, kind: str = "build", blender: str = "") -> None:
        self.builds = 0
        self._ready = False
        self._folder, environment = temporary_folder()
        self._pipe, theirs = Pipe()
        with theirs:
            self._process = subprocess.Popen(
                [*_program(blender), kind, str(theirs.fileno()), ref],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                # What a file of a user prints is for the terminal, and not part of what a command prints.
                stdout=STDERR if ref.endswith(".py") else subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=environment,
                # Ctrl-C in the terminal reaches the caller alone, which then stops this process.
                start_new_session=True,
            )

    def start(self) -> None:
        """Wait until the process is ready; raises BuildError with the reason "start"."""
        if not self._ready:
            self._receive(START_TIMEOUT_S, "start")
            self._ready = True

    def request(self, message: Any, timeout_s: float, progress: Progress | None = None) -> Any:
        """The result of a request; raises BuildError, with "timeout" after so many seconds without progress."""
        # That the process is dead is noticed when its reply is awaited.
        with contextlib.suppress(OSError):
            self._pipe.send(message)
        self.builds += 1
        return self._receive(timeout_s, "timeout", progress)

    def stop(self) -> None:
        """Kill the process and remove its temporary folder."""
        self._process.kill()
        self._process.wait()
        self._pipe.close()
        self._folder.cleanup()

    def _receive(self, timeout_s: float, late: Literal["start", "timeout"], progress: Progress | None = None) -> Any:
        """The value of the next message that is not about progress."""
        kind, value = self._next_message(timeout_s, late)
        while kind == "progress":
            if progress:
                progress(*value)
            kind, value = self._next_message(timeout_s, late)
        if kind in ("ready", "done"):
            return value
        raise BuildError("start" if late == "start" else kind, value)

    def _next_message(self, timeout_s: float, late: Literal["start", "timeout"]) -> tuple[Any, Any]:
        try:
            if not self._pipe.poll(timeout_s):
                what = "worker did not start within" if late == "start" else "build took longer than"
                raise BuildError(late, f"The {what} {timeout_s:g} s and was stopped.")
            return self._pipe.recv()
        except (EOFError, OSError):
            raise BuildError("crashed", f"The worker process died (exit code {self._exit_code()}).") from None

    def _exit_code(self) -> int:
        try:
            return self._process.wait(timeout=1)
        except subprocess.TimeoutExpired:
            # The process closed its end of the pipe and still runs.
            self._process.kill()
            return self._process.wait()
