"""Connect, estimate, and use a candidate.

A click returns at once: a timer looks at the thread that talks to the server, and Esc cancels. Called by a script, an
operator returns when the work is over, and a failure is a RuntimeError with a sentence.
"""

from functools import partial
from pathlib import Path
from typing import Any

import bpy

from . import assets, camera, inputs, server, session
from .client import ApiError
from .server import CANCELLED, Task

# Seconds between two looks at a thread.
TICK_S = 0.1


class Waiting:
    """An operator that has a thread ask the server (`begin`) and then changes Blender's data (`end`)."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return session.task is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self._start(context):
            return {"CANCELLED"}
        while session.task.is_alive():
            session.task.join(TICK_S)
        return self._finish(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self._start(context):
            return {"CANCELLED"}
        self.timer = context.window_manager.event_timer_add(TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self.cancel(context)
            context.window_manager.dipcg.status = CANCELLED
            return {"CANCELLED"}
        if event.type == "TIMER":
            _say(context, f"{session.task.note or 'Waiting for the server'} ({100 * session.task.share:.0f} %)")
            if not session.task.is_alive():
                context.window_manager.event_timer_remove(self.timer)
                return self._finish(context)
        return {"PASS_THROUGH"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender calls this too, when it closes or opens another file. The thread ends by itself."""
        context.window_manager.event_timer_remove(self.timer)
        session.task.stopped.set()
        session.task = None

    def _start(self, context: bpy.types.Context) -> bool:
        try:
            session.task = Task(self.begin(context))
        except (ApiError, OSError, ValueError) as error:
            self._fail(context, str(error))
        return session.task is not None

    def _finish(self, context: bpy.types.Context) -> set[str]:
        task, session.task = session.task, None
        if task.error:
            return self._fail(context, task.error)
        try:
            _say(context, self.end(context, task.result))
        except (RuntimeError, ValueError, LookupError) as error:
            return self._fail(context, str(error))
        return {"FINISHED"}

    def _fail(self, context: bpy.types.Context, sentence: str) -> set[str]:
        _say(context, sentence)
        self.report({"ERROR"}, sentence)
        return {"CANCELLED"}


class Connect(Waiting, bpy.types.Operator):
    """Find the server, and list the generators that it serves"""

    bl_idname, bl_label = "dipcg.connect", "Connect"

    def begin(self, context: bpy.types.Context) -> Any:
        client = server.connect(session.address(context))
        return partial(server.found, client=client, command=session.command(context))

    def end(self, context: bpy.types.Context, found: tuple[list[dict], list[dict]]) -> str:
        # The other module imports this one.
        from . import learning

        generators, trainings = found
        session.serve(context.window_manager.dipcg, context.object, generators)
        if training := session.training_of(context.object, trainings):
            learning.watch(context, training)
        return "" if generators else "The server serves no generator; start it as `dipcg serve NAME`."


class Estimate(Waiting, bpy.types.Operator):
    """Estimate the parameters of what the picture shows. Locked inputs keep their values"""

    bl_idname, bl_label = "dipcg.estimate", "Estimate"

    def begin(self, context: bpy.types.Context) -> Any:
        settings = context.window_manager.dipcg
        if not session.is_connected():
            raise ValueError("Connect to the server first.")
        if not settings.picture:
            raise ValueError("Choose a picture first.")
        generator, picture = session.chosen(settings), Path(bpy.path.abspath(settings.picture)).read_bytes()
        modifier = session.find_modifier(context.object, generator)
        self.target = (context.object.name, modifier.name) if modifier else None
        held = [p for p in generator["parameters"] if settings.locks[p["name"]].held]
        if held and not modifier:
            raise ValueError("Select the object whose inputs are locked.")
        fixed = inputs.read(modifier, held)
        client = server.connect(session.address(context))
        return partial(server.estimate, client=client, picture=picture, generator=generator["name"], fixed=fixed)

    def end(self, context: bpy.types.Context, found: server.Estimated) -> str:
        session.keep(found, self.target)
        return found.result["note"]


class UseCandidate(bpy.types.Operator):
    """Set all inputs of the modifier to this candidate, and look from the camera of the picture"""

    bl_idname, bl_label, bl_options = "dipcg.use_candidate", "Use This Candidate", {"UNDO"}
    number: bpy.props.IntProperty(options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return session.task is None and session.target is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj, modifier = session.find_target(context)
        if modifier is None:
            self.report({"ERROR"}, "The object or the modifier of this estimate is not there any more; estimate again.")
            return {"CANCELLED"}
        candidate = session.candidate(self.number)
        inputs.write(modifier, session.estimated_generator()["parameters"], candidate["params"])
        _look_at(context, obj, candidate)
        return {"FINISHED"}


class AddCandidate(Waiting, bpy.types.Operator):
    """Add this candidate with its materials, and look from the camera of the picture"""

    bl_idname, bl_label, bl_options = "dipcg.add_candidate", "Add This Candidate", {"UNDO"}
    number: bpy.props.IntProperty(options={"SKIP_SAVE"})

    def begin(self, context: bpy.types.Context) -> Any:
        self.candidate, name = session.candidate(self.number), session.estimated_generator()["name"]
        client = server.connect(session.address(context))
        return partial(server.asset, client=client, generator=name, params=self.candidate["params"])

    def end(self, context: bpy.types.Context, glb: bytes) -> str:
        root = assets.add(context, session.estimated_generator()["label"], session.temporary("asset.glb", glb))
        _look_at(context, root, self.candidate)
        return ""


CLASSES = (Connect, Estimate, UseCandidate, AddCandidate)


def _look_at(context: bpy.types.Context, obj: Any, candidate: dict) -> None:
    found = session.estimated
    picture, cutout = session.temporary("picture.png", found.picture), session.temporary("cutout.png", found.cutout)
    if points := camera.points_of(context, obj):
        camera.place(context, points, candidate["view"], picture, cutout)
        if getattr(context.space_data, "type", "") == "VIEW_3D":
            context.space_data.region_3d.view_perspective = "CAMERA"


def _say(context: bpy.types.Context, sentence: str) -> None:
    context.window_manager.dipcg.status = sentence
    redraw(context)


def redraw(context: bpy.types.Context) -> None:
    """Draw all areas anew."""
    for area in context.screen.areas if context.screen else ():
        area.tag_redraw()
