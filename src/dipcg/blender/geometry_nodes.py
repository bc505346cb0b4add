"""A Geometry Nodes modifier of a Blender file, as a table of its inputs and as a function of them.

It runs in child processes with Blender. Nothing in the file is executed, neither scripts nor Python drivers, and
nothing outside it is read.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dipcg.blender.infinigen import silence
from dipcg.mesh import Mesh, compact, make_mesh, sort_faces
from dipcg.space import Value, did_you_mean

KINDS = {"Float": "real", "Int": "integer", "Bool": "boolean", "Menu": "menu", "Vector": "vector", "Rotation": "vector"}
CASTS = {"real": float, "integer": round, "boolean": bool, "vector": float}
ANGLES = ("ANGLE", "EULER")
UNITS = {"DISTANCE": "m", "TRANSLATION": "m", "PERCENTAGE": "%", "FACTOR": "share", "TIME": "s", "TIME_ABSOLUTE": "s"}
UNITS |= dict.fromkeys(ANGLES, "°")
# Limits of this or more count as none; Blender's own defaults are so large.
ENDLESS = 1e4
COMPONENTS = "xyz"
# The first bytes of a Blender file: plain, compressed by Zstandard, and by gzip.
MAGIC = (b"BLENDER", b"\x28\xb5\x2f\xfd", b"\x1f\x8b")

# The identifier of a socket, a component, which is "" unless the input is a vector, and a value.
Setting = tuple[str, str, Value]


@dataclass(frozen=True)
class Graph:
    """An opened file: the object alone in a scene of its own, and the modifier whose inputs are set."""

    obj: Any
    modifier: Any
    layer: Any


# Blender has one file open at a time.
@lru_cache(maxsize=1)
def open_graph(path: str, name: str = "") -> Graph:
    """Open a Blender file at the object of this name, or at its only one with a Geometry Nodes modifier.

    Raises ValueError with a sentence for a file that cannot be read, reaches outside itself, or has no such object.
    """
    obj = _open(path, name)
    _realise_instances(obj)
    return Graph(obj, _modifiers(obj)[0], _layer_of(obj))


def describe(path: str, name: str = "") -> dict[str, Any]:
    """The description for `dipcg generators add`: the object, its inputs, and the inputs that are left out and why.

    Raises ValueError with a sentence when the file cannot be used, or gives no faces with its own values.
    """
    graph = open_graph(path, name)
    evaluate(graph, ())
    usable, skipped = [], {}
    for item in _sockets(graph.modifier):
        kind = KINDS.get(item.socket_type.removeprefix("NodeSocket"), "")
        options = _menu(graph.modifier, item) if kind == "menu" else {}
        if not kind or item.hide_in_modifier or (kind == "menu" and len(options) < 2):
            skipped[item.name] = _why_not(item, kind)
        else:
            usable.append(_input(graph.modifier, item, kind, list(options)))
    return {"object": graph.obj.name, "inputs": usable, "skipped": skipped}


def evaluate(graph: Graph, settings: Iterable[Setting]) -> Mesh:
    """Set inputs, let Blender evaluate the object, and read its mesh in world axes, a part for each material.

    Raises ValueError for an input that the modifier does not have, or when the result has no faces.
    """
    _set_inputs(graph.modifier, settings)
    graph.obj.update_tag()
    graph.layer.update()
    evaluated = graph.obj.evaluated_get(graph.layer.depsgraph)
    try:
        return _read(evaluated.to_mesh(), np.array(evaluated.matrix_world, np.float32), graph.obj.name)
    finally:
        evaluated.to_mesh_clear()


def save_with(_: object, path: str, name: str, settings: Iterable[Setting], target: str) -> None:
    """Open a Blender file, set inputs of the object's modifier, and save it as another, all else unchanged.

    Raises ValueError with a sentence for a file that cannot be read or written.
    """
    from dipcg.blender.scene import save

    modifier = _modifiers(_open(path, name))[0]
    _set_inputs(modifier, settings)
    save(target)


def _open(path: str, name: str) -> Any:
    import bpy

    _check_magic(path)
    try:
        bpy.ops.wm.open_mainfile(filepath=os.path.abspath(path), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise ValueError(f"Blender {bpy.app.version_string} cannot open {path}: {_reason(error)}.") from None
    _check_links(path)
    return _find(path, name)


def _reason(error: RuntimeError) -> str:
    """The message of a failed operator, without its prefix."""
    return str(error).strip().splitlines()[-1].removeprefix("Error: ").rstrip(".")


def _check_magic(path: str) -> None:
    with open(path, "rb") as file:
        start = file.read(8)
    if not start.startswith(MAGIC):
        raise ValueError(f"{path} is not a Blender file; give one that Blender saved, ending in .blend.")


def _check_links(path: str) -> None:
    """Refuse data of other files, which may change or be missing."""
    import bpy

    data = bpy.data
    outside = [library.filepath for library in data.libraries] + [cache.filepath for cache in data.cache_files]
    for blocks in (data.fonts, data.volumes):
        outside += [b.filepath for b in blocks if b.filepath not in ("", "<builtin>") and not b.packed_file]
    if outside:
        named = ", ".join(sorted(set(outside)))
        raise ValueError(
            f"{path} uses other files ({named}). In Blender, make all of it local (Object > Relations > Make Local) "
            "or pack it (File > External Data), and save."
        )


def _find(path: str, name: str) -> Any:
    import bpy

    usable = {obj.name: obj for obj in bpy.data.objects if _modifiers(obj)}
    if name and name not in bpy.data.objects:
        raise ValueError(f"{path} has no object {name!r}.{did_you_mean(name, [o.name for o in bpy.data.objects])}")
    if name and name not in usable:
        raise ValueError(f"The object {name!r} in {path} has no Geometry Nodes modifier. {_some(usable)}")
    if not usable:
        raise ValueError(f"No object in {path} has a Geometry Nodes modifier, whose inputs would be the parameters.")
    if not name and len(usable) > 1:
        names = ", ".join(usable)
        raise ValueError(f"{path} has several objects with Geometry Nodes: {names}. Name one with --object.")
    return usable[name or next(iter(usable))]


def _some(usable: dict[str, Any]) -> str:
    return f"These have one: {', '.join(usable)}." if usable else "No object in it has one."


def _modifiers(obj: Any) -> list[Any]:
    return [m for m in obj.modifiers if m.type == "NODES" and m.node_group and m.name != REALISE]


REALISE = "dipcg: realise instances"


def _realise_instances(obj: Any) -> None:
    """End the object's modifiers with one that turns instances into faces."""
    import bpy

    tree = bpy.data.node_groups.new(REALISE, "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "GeometryNodeRealizeInstances", "NodeGroupOutput")
    for before, after in pairwise([tree.nodes.new(kind) for kind in kinds]):
        tree.links.new(before.outputs[0], after.inputs[0])
    obj.modifiers.new(REALISE, "NODES").node_group = tree


def _layer_of(obj: Any) -> Any:
    """A view layer with the object alone, so that nothing hides it and nothing else is evaluated."""
    import bpy

    scene = bpy.data.scenes.new("dipcg")
    scene.collection.objects.link(obj)
    obj.hide_viewport = False
    for modifier in _modifiers(obj)[:1]:
        modifier.show_viewport = True
    scene.view_layers[0].update()
    return scene.view_layers[0]


def _sockets(modifier: Any) -> Iterator[Any]:
    for item in modifier.node_group.interface.items_tree:
        if item.item_type == "SOCKET" and item.in_out == "INPUT" and item.socket_type != "NodeSocketGeometry":
            yield item


def _why_not(item: Any, kind: str) -> str:
    if not kind:
        return f"{item.socket_type.removeprefix('NodeSocket').lower()} inputs are not parameters"
    return "hidden in the modifier" if item.hide_in_modifier else "its menu has fewer than two items"


def _menu(modifier: Any, item: Any) -> dict[str, int]:
    """The names of a menu's items and their numbers in Blender."""
    shown = modifier.id_properties_ui(item.identifier).as_dict()
    return {name: number for _, name, _, _, number in shown.get("items", ())}


def _input(modifier: Any, item: Any, kind: str, options: list[str]) -> dict[str, Any]:
    subtype = getattr(item, "subtype", "EULER" if item.socket_type == "NodeSocketRotation" else "")
    scale = 180 / np.pi if subtype in ANGLES else 1
    value = modifier[item.identifier]
    entry = {"input": item.identifier, "name": item.name, "kind": kind, "unit": UNITS.get(subtype, "")}
    entry |= {"doc": item.description, "group": item.parent.name, "options": options, "default": value}
    if kind == "menu":
        numbers = _menu(modifier, item)
        entry["default"] = next((name for name in options if numbers[name] == value), options[0])
    if kind in ("real", "integer", "vector"):
        limits = (getattr(item, "min_value", -np.inf), getattr(item, "max_value", np.inf))
        entry |= {key: _limit(v, scale) for key, v in zip(("low", "high"), limits, strict=True)}
        entry["default"] = [v * scale for v in value] if kind == "vector" else value * scale
    return entry


def _limit(value: float, scale: float) -> float | None:
    return None if abs(value) >= ENDLESS else value * scale


def _set_inputs(modifier: Any, settings: Iterable[Setting]) -> None:
    sockets = {item.identifier: item for item in _sockets(modifier)}
    for identifier, component, value in settings:
        if identifier not in sockets:
            raise ValueError(f"The modifier has no input {identifier!r}.{did_you_mean(identifier, list(sockets))}")
        _set(modifier, sockets[identifier], component, value)


def _set(modifier: Any, item: Any, component: str, value: Value) -> None:
    """Give an input a value of exactly its own type, because Blender ignores any other."""
    kind, identifier = KINDS[item.socket_type.removeprefix("NodeSocket")], item.identifier
    subtype = getattr(item, "subtype", "EULER")
    if f"{identifier}_use_attribute" in modifier:
        modifier[f"{identifier}_use_attribute"] = False
    if kind == "menu":
        modifier[identifier] = _menu(modifier, item)[str(value)]
        return
    number = CASTS[kind](np.radians(float(value)) if subtype in ANGLES else float(value))
    if component:
        modifier[identifier][COMPONENTS.index(component)] = number
    else:
        modifier[identifier] = number


def _read(mesh: Any, matrix: np.ndarray, name: str) -> Mesh:
    mesh.calc_loop_triangles()
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
    slots = np.empty(len(mesh.loop_triangles), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loop_triangles.foreach_get("vertices", faces)
    mesh.loop_triangles.foreach_get("material_index", slots)
    if not len(faces):
        raise ValueError(f"The object {name!r} has no faces; curves and points alone are no surface.")
    parts, part_of = _parts(mesh, slots, name)
    triangles = faces.reshape(-1, 3)[:, :: -1 if np.linalg.det(matrix[:3, :3]) < 0 else 1]
    world = vertices.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    return compact(sort_faces(make_mesh(world, triangles, part_of, parts)))


def _parts(mesh: Any, slots: np.ndarray, name: str) -> tuple[tuple[str, ...], np.ndarray]:
    """The names of the parts that have faces, and the part of each face; without material it has the object's name."""
    named = dict(enumerate(material.name if material else name for material in mesh.materials))
    used = {int(slot): named.get(int(slot), name) for slot in np.unique(slots)}
    parts = tuple(dict.fromkeys(used.values()))
    part_of = np.zeros(max(used) + 1, np.uint8)
    part_of[list(used)] = [parts.index(part) for part in used.values()]
    return parts, part_of[slots]


def _description(path: str, name: str) -> dict[str, Any]:
    """The description of a file, or the message of an error in its place."""
    try:
        with silence():
            return describe(path, name)
    except (ValueError, OSError) as error:
        return {"error": str(error)}


# `python -m dipcg.blender.geometry_nodes FILE [OBJECT]` prints the description as JSON.
if __name__ == "__main__":
    print(json.dumps(_description(str(Path(sys.argv[1])), "".join(sys.argv[2:]))), flush=True)
    # Blender's own shutdown is slow and sometimes crashes.
    os._exit(0)
