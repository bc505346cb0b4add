"""Pictures that are no file yet: the clipboard's, and a render of the current view."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy


class Paste(bpy.types.Operator):
    """Take the picture of the clipboard"""

    bl_idname, bl_label = "dipcg.paste", "Paste a Picture"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.area is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        # Blender pastes into an image editor only, so the area is one for this moment.
        area, kind, before = context.area, context.area.ui_type, set(bpy.data.images)
        area.ui_type = "IMAGE_EDITOR"
        try:
            bpy.ops.image.clipboard_paste()
            image = next(iter(set(bpy.data.images) - before), None)
        except RuntimeError:
            image = None
        finally:
            area.ui_type = kind
        if image is None:
            self.report({"ERROR"}, "There is no picture on the clipboard; copy one first.")
            return {"CANCELLED"}
        _use(context, image.save_render)
        bpy.data.images.remove(image)
        return {"FINISHED"}


class RenderView(bpy.types.Operator):
    """Take a render of the current view as the picture"""

    bl_idname, bl_label = "dipcg.render_view", "Render the View"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return getattr(context.space_data, "type", "") == "VIEW_3D" and not bpy.app.background

    def execute(self, context: bpy.types.Context) -> set[str]:
        space = context.space_data
        shown, space.overlay.show_overlays = space.overlay.show_overlays, False
        try:
            bpy.ops.render.opengl(view_context=True)
        except RuntimeError as error:
            self.report({"ERROR"}, f"The view cannot be rendered: {error}")
            return {"CANCELLED"}
        finally:
            space.overlay.show_overlays = shown
        _use(context, bpy.data.images["Render Result"].save_render)
        return {"FINISHED"}


CLASSES = (Paste, RenderView)


def _use(context: bpy.types.Context, save: Any) -> None:
    """Save a picture as PNG where it goes with Blender, and choose it."""
    path = Path(bpy.app.tempdir) / "dipcg_chosen.png"
    image = context.scene.render.image_settings
    before = image.file_format
    image.file_format = "PNG"
    try:
        save(str(path))
    finally:
        image.file_format = before
    context.window_manager.dipcg.picture = str(path)
