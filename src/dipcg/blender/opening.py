"""Opening a Blender file at the object that is a generator; it runs in child processes with Blender.

Nothing in the file is executed, neither scripts nor Python drivers, and nothing outside it is read.
"""

from __future__ import annotations

from typing import Any

from dipcg.blender.outside import check_nothing_outside, needed_by, trees
from dipcg.blender.sockets import Inputs, ModifierInputs, NodeInputs, inner_groups, usable
from dipcg.blender.unseen import open_unseen
from dipcg.space import did_you_mean

REALISE = "dipcg: realise instances"
Version = tuple[int, int]


def open_object(path: str, name: str = "", saved_by: Version = (0, 0)) -> Any:
    """The object of this name, or the only one whose Geometry Nodes have inputs, or the active one of several.

    `saved_by` is the version of Blender that saved the file. Raises ValueError with a sentence for a file that cannot
    be read or has no such object, and for an object that needs another file.
    """
    import bpy

    hint = ""
    if saved_by > bpy.app.version[:2]:
        hint = f" It was saved by Blender {saved_by[0]}.{saved_by[1]}; give a Blender that is as new with --blender."
    try:
        active = open_unseen(path)
    except RuntimeError as error:
        reason = hint or f" {str(error).strip().splitlines()[-1].removeprefix('Error: ').rstrip('.')}."
        raise ValueError(f"Blender {bpy.app.version_string} cannot open {path}.{reason}") from None
    obj = _find(path, name, active)
    check_nothing_outside(path, obj)
    unknown = sorted(
        {node.name for tree in trees(needed_by(obj)) for node in tree.nodes if node.bl_idname == "NodeUndefined"}
    )
    if unknown:
        named = ", ".join(unknown)
        raise ValueError(f"{path} has nodes that Blender {bpy.app.version_string} does not know: {named}.{hint}")
    return obj


def modifiers(obj: Any) -> list[Any]:
    """The Geometry Nodes modifiers of an object, without the one that is added here."""
    return [m for m in obj.modifiers if m.type == "NODES" and m.node_group and m.name != REALISE]


def find_inputs(obj: Any, name: str = "", group: tuple[str, ...] | None = None) -> tuple[Any, tuple[str, ...], Inputs]:
    """A modifier, the names of the groups that lead to its inputs, and these.

    It is the modifier and the group of these names; without names, the first modifier with inputs, or the first group
    within a modifier that has some. Raises ValueError with a sentence.
    """
    chosen = [m for m in modifiers(obj) if name in ("", m.name)]
    if not chosen:
        raise ValueError(f"{obj.name!r} has no Geometry Nodes modifier {name!r}; it has {_names(modifiers(obj))}.")
    every = [(m, (), ModifierInputs(m)) for m in chosen]
    inner = [(m, path, NodeInputs(node)) for m in chosen for path, node in inner_groups(m.node_group)]
    for modifier, path, inputs in [*every, *inner]:
        if path == group or (group is None and usable(inputs)):
            return modifier, path, inputs
    return every[0]


def python_drivers(obj: Any) -> list[str]:
    """What Python drivers, which are not run, would set on the object and on what it needs."""
    animated = [block.animation_data for block in needed_by(obj) if getattr(block, "animation_data", None)]
    drivers = [curve for animation in animated for curve in animation.drivers]
    scripted = [curve for curve in drivers if curve.driver.type == "SCRIPTED"]
    return [curve.data_path for curve in scripted if not curve.driver.is_simple_expression]


def _find(path: str, name: str, active: Any) -> Any:
    import bpy

    found = {obj.name: obj for obj in bpy.data.objects if modifiers(obj)}
    if name and name not in bpy.data.objects:
        raise ValueError(f"{path} has no object {name!r}.{did_you_mean(name, [o.name for o in bpy.data.objects])}")
    if name and name not in found:
        raise ValueError(f"The object {name!r} in {path} has no Geometry Nodes modifier. {_some(found)}")
    if not found:
        raise ValueError(f"No object in {path} has a Geometry Nodes modifier, whose inputs would be the parameters.")
    if name:
        return found[name]
    with_inputs = {name: obj for name, obj in found.items() if usable(find_inputs(obj)[2])} or found
    if len(with_inputs) > 1 and (active is None or active.name not in with_inputs):
        raise ValueError(f"{path} has several objects with Geometry Nodes: {', '.join(found)}. Name one with --object.")
    return next(iter(with_inputs.values())) if len(with_inputs) == 1 else active


def _some(found: dict[str, Any]) -> str:
    return f"These have one: {', '.join(found)}." if found else "No object in it has one."


def _names(things: Any) -> str:
    return ", ".join(thing.name for thing in things) or "none"
