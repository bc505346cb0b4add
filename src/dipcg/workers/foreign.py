"""Runs `dipcg.workers.child` in a Blender that is not ours: `blender --python foreign.py -- build|call FD GENERATOR`.

Its Python has NumPy and none of the packages of this environment, so only modules that need no other can be imported.
A Python with Blender's module runs the same file.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType


class Shapes(ModuleType):
    """Stands in for jaxtyping, whose names occur in annotations, which nothing evaluates here."""

    def __getattr__(self, name: str) -> type:
        return object


def main(arguments: list[str]) -> None:
    """Serve as `dipcg.workers.child` does, with the modules beside this file."""
    # The package is not installed here, and its folder alone is enough: its parent holds packages of another Python.
    package = ModuleType("dipcg")
    package.__path__ = [str(Path(__file__).resolve().parents[1])]
    sys.modules |= {"dipcg": package, "jaxtyping": Shapes("jaxtyping")}
    importlib.import_module("dipcg.workers.child").main(*arguments)


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
