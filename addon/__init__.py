"""A picture sets the inputs of a Geometry Nodes modifier: the add-on for Blender 4.2 and later.

It talks to `dipcg serve` on this machine. `dipcg blender-addon` packs this folder together with `client.py`, the client
of the API.
"""

import bpy

from . import learning, operators, panel, pictures, session

CLASSES = (*session.CLASSES, *operators.CLASSES, *learning.CLASSES, *pictures.CLASSES, *panel.CLASSES)


def register() -> None:
    """Make the operators, the panel and the settings known to Blender."""
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    # The window manager's properties are neither saved with a file nor undone.
    bpy.types.WindowManager.dipcg = bpy.props.PointerProperty(type=session.Settings)


def unregister() -> None:
    """Stop what runs, and take all of it back."""
    session.close()
    if session.watching:
        session.watching.stopped.set()
        session.watching = None
    del bpy.types.WindowManager.dipcg
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)
