"""Blender for other things than building: writing its files, baking and drawing, in a child process of its own."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from dipcg.workers.process import BuildError, Child, Progress

MOST_S = 600.0  # without a word of progress


class BlenderError(RuntimeError):
    """Something that Blender could not do, with a sentence that says why."""


class Blender:
    """A child process that runs functions of `dipcg.blender`, where alone Blender is imported; a context manager.

    Not one of those that build: the scenes made here would lie among what a generator keeps there.
    Raises ModuleNotFoundError with the command that helps when Blender's module is not installed.
    """

    def __init__(self) -> None:
        if find_spec("bpy") is None:
            raise ModuleNotFoundError(
                "Blender's module is missing: run `pip install 'dipcg[infinigen]'` (Python 3.11)."
            )
        self._child = Child("", "call")

    def call(self, function: str, *arguments: Any, progress: Progress | None = None, timeout_s: float = MOST_S) -> Any:
        """Run `module:function` of `dipcg.blender`, which gets a function for progress and then the arguments.

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
