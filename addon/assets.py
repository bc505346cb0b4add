"""Assets of generators that ship, which come as GLB."""

from __future__ import annotations

from typing import Any

import bpy


def add(context: bpy.types.Context, name: str, path: str) -> Any:
    """Import a GLB with its materials; returns the one object that all of it is below.

    Raises RuntimeError with a sentence when Blender cannot read it.
    """
    if not hasattr(bpy.types, "IMPORT_SCENE_OT_gltf"):
        raise RuntimeError("Switch on the add-on 'glTF 2.0 format' in Blender's preferences, which reads the asset.")
    before = set(context.scene.objects)
    bpy.ops.import_scene.gltf(filepath=path)
    tops = [obj for obj in set(context.scene.objects) - before if obj.parent is None]
    return tops[0] if len(tops) == 1 else _above(context, name, tops)


def _above(context: bpy.types.Context, name: str, objects: list[Any]) -> Any:
    """A new empty object that is the parent of these."""
    root = bpy.data.objects.new(name, None)
    context.collection.objects.link(root)
    for obj in objects:
        obj.parent = root
    return root
