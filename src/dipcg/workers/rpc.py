"""Blender for other things than building: writing its files, baking and drawing, in a child process of its own."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from dipcg.workers.process import BuildError, Child, Progress

# The longest time without a message about progress.
TIMEOUT_S = 600.0


class BlenderError(RuntimeError):
    """Blender could not do something; the message says what and why."""


class Blender:
    """A child process that runs functions of `dipcg.blender`; a context manager.

    It is not one of those that build: a generator keeps its node graphs in its process, and scenes made here would
    disturb them. `program` is another Blender to run. Raises ModuleNotFoundError with the command that helps when
    Blender's module is not installed.
    """

    def __init__(self, program: str = "") -> None:
        if not program and find_spec("bpy") is None:
            raise ModuleNotFoundError(
                "Blender's module is missing: run `pip install 'dipcg[infinigen]'` (Python 3.11)."
            )
        self._child = Child("", "call", program)

    def call(
        self, function: str, *arguments: Any, progress: Progress | None = None, timeout_s: float = TIMEOUT_S
    ) -> Any:
        """Run `module:function` of `dipcg.blender` with a function that reports progress, and the arguments.

        Raises BlenderError with a sentence.
        """
        try:
            self._child.start()
            return self._child.request((f"blender.{function}", arguments), timeout_s, progress)
        except BuildError as error:
            raise BlenderError(str(error)) from None

    def __enter__(self) -> Blender:
        return self

    def __exit__(self, *_: object) -> None:
        self._child.stop()
