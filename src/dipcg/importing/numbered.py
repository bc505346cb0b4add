"""Numbered options: how many of them a program has, found by building them one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dipcg.importing.trials import Trials, Tried
from dipcg.mesh import Mesh
from dipcg.mesh.order import differs
from dipcg.space import Params


def trim_options(trials: Trials, name: str, entry: dict[str, Any], tried: Sequence[Params]) -> None:
    """Keep those of the numbered options, 0 and up, that give different meshes in one of the contexts."""
    numbers = range(entry["low"], entry["high"] + 1)
    for context in tried:
        meshes = trials.meshes([context | {name: number} for number in numbers])
        last = _last_option(meshes)
        if last > 0:
            entry["high"] = max(entry["low"] + last, entry["default"])
            entry["why"] = f"a numbered option; beyond {entry['high']}, nothing new comes"
            return


def _last_option(meshes: Sequence[Tried]) -> int:
    """The position of the last mesh before options that are all the same.

    Beyond the last option a program either repeats it or leaves the piece away, in which case the mesh is smaller than
    all others.
    """
    new = [i for i, mesh in enumerate(meshes) if isinstance(mesh, Mesh) and not _is_there(mesh, meshes[:i])]
    if len(new) < 2 or new[-1] == len(meshes) - 1:
        return len(new) and new[-1]
    sizes = [len(mesh.faces) for mesh in (meshes[i] for i in new) if isinstance(mesh, Mesh)]
    return new[-2] if sizes[-1] < min(sizes[:-1]) else new[-1]


def _is_there(mesh: Mesh, others: Sequence[Tried]) -> bool:
    return any(isinstance(other, Mesh) and not differs(mesh, other) for other in others)
