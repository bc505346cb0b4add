"""The panel in the sidebar of the 3D viewport."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

from . import inputs, session

COLUMNS, ICON_SCALE = 2, 5.0
# What the button for learning says, by the state of the training.
LEARN = {"stopped": "Go On", "done": "Learn More"}


class Panel:
    """Where the panels are."""

    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "dipcg"


class Estimating(Panel, bpy.types.Panel):
    bl_idname, bl_label = "DIPCG_PT_estimating", "From a Picture"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.window_manager.dipcg
        layout.operator("dipcg.connect", icon="FILE_REFRESH")
        if session.is_connected():
            row = layout.row(align=True)
            row.prop(settings, "picture")
            row.operator("dipcg.paste", text="", icon="PASTEDOWN")
            row.operator("dipcg.render_view", text="", icon="RENDER_STILL")
            layout.prop(settings, "generator")
            layout.label(text=_what_for(context, settings))
            again = any(lock.held for lock in settings.locks)
            layout.operator("dipcg.estimate", text="Estimate the Rest Again" if again else "Estimate")
        _write_sentence(context, layout, settings.status)


class Candidates(Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "DIPCG_PT_candidates", "Candidates", "DIPCG_PT_estimating"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return session.estimated is not None

    def draw(self, context: bpy.types.Context) -> None:
        grid = self.layout.grid_flow(columns=COLUMNS, row_major=True, even_columns=True)
        operator = "dipcg.use_candidate" if session.target else "dipcg.add_candidate"
        for number, candidate in enumerate(session.estimated.result["candidates"]):
            cell = grid.box().column()
            cell.template_icon(session.icon(number), scale=ICON_SCALE)
            cell.operator(operator, text=_match(candidate)).number = number


class Parameters(Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "DIPCG_PT_parameters", "Parameters", "DIPCG_PT_estimating"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return session.is_connected() and _modifier(context) is not None

    def draw(self, context: bpy.types.Context) -> None:
        settings, modifier = context.window_manager.dipcg, _modifier(context)
        for parameter in session.chosen(settings)["parameters"]:
            _draw_row(self.layout.row(), settings.locks[parameter["name"]], modifier, parameter)


class Learning(Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_options = "DIPCG_PT_learning", "Learn This Generator", {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return session.is_connected()

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings, training = self.layout, context.window_manager.dipcg, session.training
        layout.operator("dipcg.propose")
        if training is None:
            return
        column = layout.column(align=True)
        for one in settings.ranges:
            _draw_range(column, one)
        row = layout.row(align=True)
        row.prop(settings, "shapes")
        row.prop(settings, "minutes")
        layout.operator("dipcg.learn", text=LEARN.get(training["state"], "Learn This Generator"))
        if session.watching:
            layout.operator("dipcg.stop_learning")
        _write_sentence(context, layout, settings.progress or training["error"] or "")


CLASSES = (Estimating, Candidates, Parameters, Learning)


def _draw_range(column: Any, one: Any) -> None:
    row = column.row(align=True)
    row.prop(one, "used", text=one.name.replace("_", " "))
    if one.is_number and one.used:
        row.prop(one, "low", text="")
        row.prop(one, "high", text="")


def _modifier(context: bpy.types.Context) -> Any:
    return session.find_modifier(context.object, session.chosen(context.window_manager.dipcg))


def _what_for(context: bpy.types.Context, settings: Any) -> str:
    modifier = _modifier(context)
    return f"Sets {context.object.name}: {modifier.name}" if modifier else "Adds a new object"


def _match(candidate: dict) -> str:
    agreement = candidate["agreement"]
    return "Use" if agreement is None else f"{100 * agreement:.0f} % match"


def _write_sentence(context: bpy.types.Context, layout: Any, sentence: str) -> None:
    """A sentence in lines as wide as the sidebar, since a label has one line."""
    width = max(20, context.region.width // 8 if context.region else 40)
    for line in textwrap.wrap(sentence, width):
        layout.label(text=line)


def _draw_row(row: Any, lock: Any, modifier: Any, parameter: dict) -> None:
    """A lock, the slider of the input, and the spread over the candidates."""
    row.prop(lock, "held", text="", icon="LOCKED" if lock.held else "UNLOCKED", emboss=False)
    owner, name = inputs.slider(modifier, parameter["input"])
    index = {"index": inputs.AXES.index(parameter["component"])} if parameter["component"] else {}
    row.prop(owner, name, text=parameter["label"], **index)
    row.label(text=session.spread(parameter))
