"""dipcg: from a picture to the parameters of a procedural generator, and so to an exact, light, editable asset."""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dipcg.inference.again import look_again
    from dipcg.inference.colours import with_colours
    from dipcg.inference.rank import rank
    from dipcg.inference.refine import refine
    from dipcg.pipeline import Candidate, Estimate, Inverter
    from dipcg.registry import allow_code

__version__ = "0.1.0"
__all__ = ["Candidate", "Estimate", "Inverter", "allow_code", "look_again", "rank", "refine", "with_colours"]

# Importing torch takes seconds, so these are loaded at their first use.
_HOMES = {"Candidate": "pipeline", "Estimate": "pipeline", "Inverter": "pipeline"}
_HOMES |= {"rank": "inference.rank", "refine": "inference.refine", "allow_code": "registry"}
_HOMES |= {"with_colours": "inference.colours", "look_again": "inference.again"}
# Modules of version 0.1.0 that its documentation names. Their old names still work.
_MOVED = {"codec": "data.codec", "preview": "inference.preview", "rank": "inference.rank"}
_MOVED |= {"refine": "inference.refine", "worker": "workers.pool"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'dipcg' has no attribute {name!r}")
    return getattr(import_module(f"dipcg.{_HOMES[name]}"), name)


class _Alias(ModuleType):
    """A module under an old name, which loads the new one when something is read from it."""

    def __getattr__(self, name: str) -> Any:
        # Tools that look at all loaded modules ask for `__file__` and the like, and must not load anything.
        if name.startswith("__"):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"dipcg.{_MOVED[self.__name__.removeprefix('dipcg.')]}"), name)


sys.modules.update({f"dipcg.{old}": _Alias(f"dipcg.{old}") for old in _MOVED})
