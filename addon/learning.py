"""Learn this generator: the server proposes ranges for the active modifier, trains on its own, and a timer looks on."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import bpy

from . import operators, server, session
from .server import Task

# Seconds between two looks at the thread that follows a training.
LOOK_S = 0.5


class Propose(operators.Waiting, bpy.types.Operator):
    """Send this file to the server on this machine, which proposes ranges for the inputs of the modifier"""

    bl_idname, bl_label = "dipcg.propose", "Propose Ranges"

    def begin(self, context: bpy.types.Context) -> Any:
        obj = context.object
        modifier = next((m for m in obj.modifiers if m.type == "NODES" and m.node_group), None) if obj else None
        if modifier is None:
            raise ValueError("Select an object with a Geometry Nodes modifier first.")
        active = obj.modifiers.active
        modifier = active if active and active.type == "NODES" and active.node_group else modifier
        names = {"object": obj.name, "modifier": modifier.name}
        client = server.connect(session.address(context))
        return partial(server.propose, client=client, source=_copy(), file=f"{obj.name}.blend", **names)

    def end(self, context: bpy.types.Context, found: dict) -> str:
        session.take_training(context.window_manager.dipcg, found)
        return "Look at the ranges, and edit them. Then learn."


class Learn(operators.Waiting, bpy.types.Operator):
    """Build data and train beside Blender, with the ranges above; also after Blender is closed"""

    bl_idname, bl_label = "dipcg.learn", "Learn This Generator"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        idle = session.task is None and session.training is not None
        return idle and session.training["state"] not in server.WORKING

    def begin(self, context: bpy.types.Context) -> Any:
        settings, client = context.window_manager.dipcg, server.connect(session.address(context))
        wanted = {"ranges": settings.edited_ranges(), "hold": settings.held()}
        amount = {"shapes": settings.shapes, "minutes": settings.minutes}
        return partial(server.learn, client=client, training=session.training["id"], **wanted, **amount)

    def end(self, context: bpy.types.Context, found: dict) -> str:
        watch(context, found)
        return ""


class StopLearning(operators.Waiting, bpy.types.Operator):
    """Stop, and keep what is learned; it can go on later"""

    bl_idname, bl_label = "dipcg.stop_learning", "Stop"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return session.task is None and session.training is not None

    def begin(self, context: bpy.types.Context) -> Any:
        client = server.connect(session.address(context))
        return partial(server.stop, client=client, training=session.training["id"])

    def end(self, context: bpy.types.Context, found: dict) -> str:
        session.take_training(context.window_manager.dipcg, found)
        return "Stopped. It goes on where it was."


CLASSES = (Propose, Learn, StopLearning)


def watch(context: bpy.types.Context, training: dict[str, Any]) -> None:
    """Follow a training in a thread, and show how far it is, until nothing is done for it any more."""
    session.take_training(context.window_manager.dipcg, training)
    if session.watching:
        session.watching.stopped.set()
    session.watching = None
    if training["state"] in server.WORKING:
        client = server.connect(session.address(context))
        session.watching = Task(partial(server.watch, client=client, training=training["id"]))
        if not bpy.app.timers.is_registered(look):
            bpy.app.timers.register(look, first_interval=LOOK_S)


def look() -> float | None:
    """What the timer does: show the progress, and take the generator when it is learned. None ends the timer."""
    task, settings = session.watching, bpy.context.window_manager.dipcg
    if task is None:
        return None
    settings.progress = f"{task.note} ({100 * task.share:.0f} %)" if task.note else ""
    operators.redraw(bpy.context)
    if task.is_alive():
        return LOOK_S
    session.watching, settings.progress = None, ""
    if task.error:
        settings.status = task.error
        return None
    training, generators = task.result
    session.take_training(settings, training)
    session.serve(settings, bpy.context.object, generators)
    settings.status = training["error"] or ("Learned. Now estimate." if training["state"] == "done" else "")
    return None


def _copy() -> bytes:
    """The open file as it is now; its own file is not changed."""
    path = Path(bpy.app.tempdir) / "dipcg_source.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=True)
    try:
        return path.read_bytes()
    finally:
        path.unlink()
