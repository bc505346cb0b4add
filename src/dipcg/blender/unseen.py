"""A Blender file that is opened, and saved again, without Blender evaluating its scenes.

It runs in child processes with Blender. Opening a file evaluates the scene that it shows, and this reads and writes
files: a mesh cache is read, and a simulation of smoke writes into any folder that the Blender file names. Nothing
can be checked before. So the windows show an empty scene from the moment when the file is there until it is saved.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import Any

# The scene that the open file shows, and the empty one in its place; Blender has one file open at a time.
_scenes: dict[str, Any] = {}


def open_unseen(path: str) -> Any:
    """Open a Blender file without its scripts, and return its active object; raises RuntimeError."""
    import bpy

    active = []

    # Others are removed when a file is opened.
    @bpy.app.handlers.persistent
    def hide(*_: object) -> None:
        active.append(_window().view_layer.objects.active)
        _hide()

    bpy.app.handlers.load_post.append(hide)
    try:
        bpy.ops.wm.open_mainfile(filepath=os.path.abspath(path), load_ui=False, use_scripts=False)
    finally:
        bpy.app.handlers.load_post.remove(hide)
    # With this a file tells Blender to pack all files that it names, whatever they are, when it is saved.
    bpy.data.use_autopack = False
    return active[0]


@contextlib.contextmanager
def saved_as_opened() -> Iterator[None]:
    """Within it, the file is saved with the scene that it showed."""
    import bpy

    handlers = bpy.app.handlers
    handlers.save_pre.append(_show)
    handlers.save_post.append(_hide)
    try:
        yield
    finally:
        handlers.save_pre.remove(_show)
        handlers.save_post.remove(_hide)


def _hide(*_: object) -> None:
    import bpy

    window, empty = _window(), bpy.data.scenes.new("dipcg: empty")
    # The name of the layer stays that of the window.
    empty.view_layers[0].name = window.view_layer.name
    _scenes.update(shown=window.scene, empty=empty)
    for other in bpy.context.window_manager.windows:
        other.scene = empty


def _show(*_: object) -> None:
    import bpy

    # Setting the scene of a window would evaluate it.
    _scenes["empty"].user_remap(_scenes["shown"])
    bpy.data.scenes.remove(_scenes["empty"])


def _window() -> Any:
    import bpy

    return bpy.context.window_manager.windows[0]
