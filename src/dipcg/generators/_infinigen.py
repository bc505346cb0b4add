"""What the adapters over Infinigen share: a silent import, fixed draws, a clean Blender, meshes as arrays.

Every function here runs in a worker process, the only place where Blender is imported.
"""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np

from dipcg.mesh import triangulate

Piece = tuple[str, np.ndarray, np.ndarray]


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Send everything written to file descriptors 1 and 2 to nowhere; Blender writes from C."""
    kept = [os.dup(1), os.dup(2)]
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        for target, saved in zip((1, 2), kept, strict=True):
            os.dup2(saved, target)
            os.close(saved)


def import_infinigen(module: str) -> ModuleType:
    """Import a module of Infinigen without its chatter or its attempts to reach the network."""
    with silence(), _one_thread():
        import bpy

        bpy.context.preferences.system.use_online_access = False
        bpy.context.preferences.edit.use_global_undo = False
        return importlib.import_module(module)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Let Blender count one processor while it starts: its threads cost a chair a fifth more than they save."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    every = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(every)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, every)


@contextlib.contextmanager
def replaced(target: Any, **replacements: Any) -> Iterator[None]:
    """Give attributes of a module other values for a while."""
    before = {name: getattr(target, name) for name in replacements}
    for name, value in replacements.items():
        setattr(target, name, value)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(target, name, value)


def middle(low: float = 0.0, high: float = 1.0, size: Any = None) -> Any:
    """Stands in for `uniform` where a factory draws while it builds: the middle of the range."""
    value = (np.asarray(low) + np.asarray(high)) / 2
    return float(value) if size is None and value.ndim == 0 else np.broadcast_to(value, size or value.shape).copy()


def coarse_modifiers(butil: ModuleType, segments: int = 2) -> Any:
    """`modify_mesh` of Infinigen with fewer segments in its bevels, for light builds."""
    modify = butil.modify_mesh

    def modify_coarsely(obj: Any, kind: str, *args: Any, **settings: Any) -> Any:
        if kind == "BEVEL":
            settings["segments"] = segments
        return modify(obj, kind, *args, **settings)

    return modify_coarsely


def clean_blender() -> None:
    """Remove all that earlier builds left behind, or Blender becomes slower with each one."""
    import bpy

    data = bpy.data
    for blocks in (data.objects, data.meshes, data.curves, data.node_groups):
        data.batch_remove(blocks)


def read_piece(part: str, obj: Any) -> Piece:
    """A Blender object's mesh in world axes as (part, vertices, triangles), triangles in an order of our own.

    Blender lists the faces of one and the same mesh in an order that depends on memory addresses.
    """
    mesh = obj.data
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    corners = np.empty(len(mesh.loops), np.int32)
    sizes = np.empty(len(mesh.polygons), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.polygons.foreach_get("loop_total", sizes)
    matrix = np.array(obj.matrix_basis, np.float32)
    triangles = _sorted(triangulate(sizes, corners)[0])
    return part, vertices.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3], triangles


def _sorted(triangles: np.ndarray) -> np.ndarray:
    first = triangles.argmin(1)[:, None]
    turned = np.take_along_axis(triangles, (first + np.arange(3)) % 3, 1)
    return turned[np.lexsort(turned.T[::-1])]
