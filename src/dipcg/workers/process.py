"""A child process and the socket to it: start it, send it requests with a time limit, stop it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import psutil

from dipcg.blender.temporary import temporary_folder
from dipcg.mesh import MeshError
from dipcg.space import Params
from dipcg.workers.memory import allowed_bytes, used_bytes
from dipcg.workers.messages import Channel, MessageError

START_TIMEOUT_S = 120.0
# How often the memory of a working process is looked at, in seconds.
CHECK_S = 0.5
# The file descriptor of the standard error of this process.
STDERR = 2
FOREIGN = Path(__file__).with_name("foreign.py")
NO_MESSAGE = "The worker process sent something else than a result and was stopped."

# raised: the generator raised an error; unusable: its mesh cannot be used; start: the process did not start.
Reason = Literal["raised", "unusable", "timeout", "memory", "crashed", "start"]
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
        allow = f" with --allow-code {self.generator}" if self.generator.endswith(".py") else ""
        return f"`dipcg edit`{allow} builds it again from a file with: {file}"


def _program(blender: str) -> list[str]:
    """The command line of a child up to its arguments."""
    if not blender:
        # With -P a file in the working folder that is called like a module of Python is not taken for it.
        return [sys.executable, "-P", "-m", "dipcg.workers.child"]
    if "python" in Path(blender).name.lower():
        return [blender, str(FOREIGN)]
    return [blender, "--background", "--factory-startup", "--python-exit-code", "1", "--python", str(FOREIGN), "--"]


class Child:
    """One process that runs `dipcg.workers.child`, and the socket to it; one thread uses it.

    `blender` is another Blender to run it in, or a Python that has Blender's module.
    """

    def __init__(self, ref: str, kind: Literal["build", "call"] = "build", blender: str = "") -> None:
        self.builds = 0
        self._ready, self._kind = False, kind
        self._folder, environment = temporary_folder()
        ours, theirs = socket.socketpair()
        self._channel = Channel(ours)
        with theirs:
            # What a file of a user prints is for the terminal, and not part of what a command prints.
            output = STDERR if ref.endswith(".py") else subprocess.DEVNULL
            command = [*_program(blender), kind, str(theirs.fileno()), ref]
            self._process = _start(
                command, output, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, env=environment
            )
        # When the caller is killed, its end of this pipe closes, and the shell kills the child and what it has started.
        self._guard = _start(["/bin/sh", "-c", f"read _; kill -9 -{self._process.pid}"], stdin=subprocess.PIPE)

    def start(self) -> None:
        """Wait until the process is ready; raises BuildError with the reason "start"."""
        if not self._ready:
            self._receive(START_TIMEOUT_S, "start")
            self._ready = True

    def request(self, message: Any, timeout_s: float, progress: Progress | None = None) -> Any:
        """The result of a request; raises BuildError, with "timeout" after so many seconds without progress."""
        # That the process is dead or does not read is noticed when its reply is awaited.
        with contextlib.suppress(OSError):
            self._channel.send(message, timeout_s)
        self.builds += 1
        return self._receive(timeout_s, "timeout", progress)

    def kill(self) -> None:
        """Kill the process and all that it has started, from any thread; who waits for a result gets a BuildError."""
        _kill_with_descendants(self._process.pid)

    def stop(self) -> None:
        """Kill the process and all that it has started, and remove its temporary folder."""
        self._guard.kill()
        self._guard.communicate()
        _kill_with_descendants(self._process.pid)
        self._process.wait()
        self._channel.close()
        self._folder.cleanup()

    def _receive(self, timeout_s: float, late: Literal["start", "timeout"], progress: Progress | None = None) -> Any:
        """The value of the next message that is not about progress."""
        while True:
            match self._next_message(timeout_s, late):
                case "progress", (float(share), str(note)) if self._kind == "call":
                    if progress:
                        progress(share, note)
                case ("ready" | "done", value):
                    return value
                case ("raised" | "unusable" | "start" as reason, str(sentence)):
                    raise BuildError("start" if late == "start" else reason, sentence)
                case _:
                    raise BuildError("crashed", NO_MESSAGE)

    def _next_message(self, timeout_s: float, late: Literal["start", "timeout"]) -> Any:
        deadline = time.monotonic() + timeout_s
        try:
            while not self._channel.wait(min(CHECK_S, timeout_s)) and time.monotonic() < deadline:
                self._check_memory()
            return self._channel.receive(max(deadline - time.monotonic(), 1e-3))
        except TimeoutError:
            what = "worker did not start within" if late == "start" else "build took longer than"
            raise BuildError(late, f"The {what} {timeout_s:g} s and was stopped.") from None
        except MeshError as error:
            raise BuildError("unusable", str(error)) from None
        except MessageError:
            raise BuildError("crashed", NO_MESSAGE) from None
        except (EOFError, OSError):
            raise BuildError("crashed", f"The worker process died (exit code {self._exit_code()}).") from None

    def _check_memory(self) -> None:
        """Raise BuildError when the process takes more memory than it may; the caller then replaces it."""
        if used_bytes(self._process.pid) > allowed_bytes():
            most = f"{allowed_bytes() / 2**30:.3g} GB"
            raise BuildError("memory", f"The build needed more than {most} of memory and was stopped.")

    def _exit_code(self) -> int:
        try:
            return self._process.wait(timeout=1)
        except subprocess.TimeoutExpired:
            # The process closed its end of the socket and still runs.
            self._process.kill()
            return self._process.wait()


def _start(command: list[str], output: int = subprocess.DEVNULL, **options: Any) -> subprocess.Popen:
    """A process in a session of its own, so that Ctrl-C in the terminal reaches the caller alone, which stops it."""
    return subprocess.Popen(command, stdout=output, stderr=subprocess.DEVNULL, start_new_session=True, **options)


def _kill_with_descendants(pid: int) -> None:
    """Kill a process, its group, and what has left the group."""
    below = []
    with contextlib.suppress(psutil.NoSuchProcess):
        below = psutil.Process(pid).children(recursive=True)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
    for process in below:
        with contextlib.suppress(psutil.NoSuchProcess):
            process.kill()
