"""Blender for other things than building: writing its files, baking and drawing, in a child process of its own."""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
from importlib.util import find_spec
from multiprocessing.connection import Connection
from typing import Any

from dipcg.workers.pool import BuildError, Child, Progress, die_with_parent, told

MOST_S = 600.0  # without a word of progress


class BlenderError(RuntimeError):
    """Something that Blender could not do, with a sentence that says why."""


class Blender:
    """A child process that runs functions of `dipcg.generators`, where alone Blender is imported; a context manager.

    Not one of those that build: the scenes made here would lie among what a generator keeps there.
    Raises ModuleNotFoundError with the command that helps when Blender's module is not installed.
    """

    def __init__(self) -> None:
        if find_spec("bpy") is None:
            raise ModuleNotFoundError(
                "Blender's module is missing: run `pip install 'dipcg[infinigen]'` (Python 3.11)."
            )
        self._child = Child("", "dipcg.workers.rpc")

    def call(self, function: str, *arguments: Any, progress: Progress | None = None, timeout_s: float = MOST_S) -> Any:
        """Run `module:function` of `dipcg.generators`, which gets a function for progress and then the arguments.

        Raises BlenderError with a sentence.
        """
        try:
            self._child.start()
            return self._child.ask((function, arguments), timeout_s, progress)
        except BuildError as error:
            raise BlenderError(str(error)) from None

    def __enter__(self) -> Blender:
        return self

    def __exit__(self, *_: object) -> None:
        self._child.stop()


def _serve(pipe: Connection) -> None:
    """The child's loop: answer each (function, arguments) with what it returns or a sentence."""
    pipe.send(("ready", None))
    while True:
        function, arguments = pipe.recv()
        module, name = function.split(":")
        try:
            found = getattr(importlib.import_module(f"dipcg.generators.{module}"), name)
            answer = ("done", found(lambda share, note: pipe.send(("progress", (share, note))), *arguments))
        except ValueError as error:
            answer = ("raised", str(error))
        except Exception as error:
            answer = ("raised", f"Blender could not do this: {told(error)}.")
        pipe.send(answer)


if __name__ == "__main__":
    die_with_parent()
    with contextlib.suppress(EOFError, BrokenPipeError, KeyboardInterrupt):
        _serve(Connection(int(sys.argv[1])))
    os._exit(0)  # Blender's own shutdown is slow and sometimes crashes
