"""A Geometry Nodes modifier of a Blender file, as a table of its inputs and as a function of them.

It runs in child processes with Blender, which may be another than ours.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from dipcg.blender.opening import REALISE, Version, find_inputs, modifiers, open_object, python_drivers
from dipcg.blender.outside import forget_pictures
from dipcg.blender.sockets import (
    Inputs,
    ModifierInputs,
    NodeInputs,
    Place,
    Setting,
    Socket,
    add_geometry_sockets,
    sockets,
    usable,
)
from dipcg.mesh import Mesh, make_mesh, pairs
from dipcg.mesh.order import sort_faces
from dipcg.mesh.simplify import compact
from dipcg.space import Value, did_you_mean

CASTS = {"real": float, "integer": round, "boolean": bool, "vector": float}
ANGLES = ("ANGLE", "EULER")
UNITS = {"DISTANCE": "m", "TRANSLATION": "m", "PERCENTAGE": "%", "FACTOR": "share", "TIME": "s", "TIME_ABSOLUTE": "s"}
UNITS |= dict.fromkeys(ANGLES, "°")
COMPONENTS = "xyz"
# What a node graph can make that has no faces, by Blender's type, and the node that gives it faces.
WITHOUT_FACES = {
    "CURVE": "curves (Curve to Mesh)",
    "CURVES": "curves (Curve to Mesh)",
    "POINTCLOUD": "points (Instance on Points)",
    "VOLUME": "volumes (Volume to Mesh)",
}


@dataclass(frozen=True)
class Graph:
    """An opened file: the object alone in a scene of its own, and the inputs that are set."""

    obj: Any
    inputs: Inputs
    layer: Any


# Blender has one file open at a time.
@lru_cache(maxsize=1)
def open_graph(path: str, name: str, modifier: str, group: tuple[str, ...]) -> Graph:
    """Open a Blender file at the inputs of a modifier or of a group in it; raises ValueError with a sentence."""
    obj = open_object(path, name)
    found, _, inputs = find_inputs(obj, modifier, group)
    return _alone(obj, found, inputs)


def describe(_: object, path: str, name: str, modifier: str, saved_by: Sequence[int]) -> dict[str, Any]:
    """The description for `dipcg generators add`: the object, its inputs, those that are left out and why, and notes.

    Raises ValueError with a sentence when the file cannot be used, or gives no faces with its own values.
    """
    version = (saved_by[0], saved_by[1])
    obj = open_object(path, name, version)
    found, group, inputs = find_inputs(obj, modifier)
    graph = _alone(obj, found, inputs)
    mesh = evaluate(graph, ())
    free = usable(inputs)
    return {
        "object": obj.name,
        "modifier": found.name,
        "group": list(group),
        "side": mesh.side,
        "inputs": [_input(inputs, socket) for socket in free],
        "skipped": {socket.name: _why_not(inputs, socket) for socket in sockets(inputs.tree) if socket not in free},
        "notes": [*_without_faces(graph), *_notes(obj, path, version)],
    }


def evaluate(graph: Graph, settings: Iterable[Setting]) -> Mesh:
    """Set inputs, let Blender evaluate the object, and read its mesh in world axes, a part for each material.

    Raises ValueError for an input that the modifier does not have, or when the result has no faces.
    """
    _set_inputs(graph.inputs, settings)
    graph.obj.update_tag()
    graph.layer.update()
    evaluated = graph.obj.evaluated_get(graph.layer.depsgraph)
    try:
        return _read(evaluated.to_mesh(), np.array(evaluated.matrix_world, np.float32), graph.obj.name)
    finally:
        evaluated.to_mesh_clear()


def save_with(_: object, place: Place, settings: Iterable[Setting], target: str) -> None:
    """Open a Blender file, set inputs of the object's modifier, and save it as another, all else unchanged.

    Raises ValueError with a sentence for a file that cannot be read or written.
    """
    import bpy

    from dipcg.blender.scene import save
    from dipcg.blender.unseen import saved_as_opened

    path, name, modifier, group = place
    _set_inputs(find_inputs(open_object(path, name), modifier, tuple(group))[2], settings)
    # The file is saved in one folder and then moved to another, so relative paths would lead elsewhere.
    bpy.ops.file.make_paths_absolute()
    with saved_as_opened():
        save(target)


def _alone(obj: Any, modifier: Any, inputs: Inputs) -> Graph:
    forget_pictures()
    _realise_instances(obj)
    return Graph(obj, inputs, _layer_of(obj, modifier))


def _realise_instances(obj: Any) -> None:
    """End the object's modifiers with one that turns instances into faces."""
    import bpy

    tree = bpy.data.node_groups.new(REALISE, "GeometryNodeTree")
    add_geometry_sockets(tree)
    kinds = ("NodeGroupInput", "GeometryNodeRealizeInstances", "NodeGroupOutput")
    for before, after in pairwise([tree.nodes.new(kind) for kind in kinds]):
        tree.links.new(before.outputs[0], after.inputs[0])
    obj.modifiers.new(REALISE, "NODES").node_group = tree


def _layer_of(obj: Any, modifier: Any) -> Any:
    """A view layer with the object alone, so that nothing hides it and nothing else is evaluated."""
    import bpy

    scene = bpy.data.scenes.new("dipcg")
    scene.collection.objects.link(obj)
    obj.hide_viewport, modifier.show_viewport = False, True
    scene.view_layers[0].update()
    return scene.view_layers[0]


def _why_not(inputs: Inputs, socket: Socket) -> str:
    if not socket.kind:
        return f"{socket.type.lower()} inputs are not parameters"
    if socket.hidden:
        return "hidden in the modifier"
    return "its menu has fewer than two items" if inputs.is_free(socket) else "a node decides its value"


def _input(inputs: Inputs, socket: Socket) -> dict[str, Any]:
    """An input as plain values, angles in degrees."""
    entry = {"input": socket.identifier, "name": socket.name, "kind": socket.kind, "subtype": socket.subtype}
    entry |= {"unit": UNITS.get(socket.subtype, ""), "doc": socket.doc, "group": socket.panel}
    entry |= {"options": inputs.options(socket) if socket.kind == "menu" else []}
    entry |= {"default": _plain(socket, inputs.read(socket)), "others": _others(inputs, socket)}
    limits = {"low": socket.low, "high": socket.high}
    return entry | {key: v if v is None else v * _scale(socket) for key, v in limits.items()}


def _plain(socket: Socket, value: Any) -> Any:
    if socket.kind == "vector":
        return [float(v) * _scale(socket) for v in value]
    return value if isinstance(value, (bool, int, str)) else float(value) * _scale(socket)


def _scale(socket: Socket) -> float:
    return 180 / np.pi if socket.subtype in ANGLES else 1.0


def _others(inputs: Inputs, socket: Socket) -> dict[str, Any]:
    """The values that the same input has elsewhere in the file, by the object or group that has it."""
    import bpy

    used = [(obj.name, ModifierInputs(modifier)) for obj in bpy.data.objects for modifier in modifiers(obj)]
    groups = [(tree.name, node) for tree in bpy.data.node_groups for node in tree.nodes if node.type == "GROUP"]
    used += [(name, NodeInputs(node)) for name, node in groups]
    same = {name: one for name, one in used if one != inputs and one.tree == inputs.tree and one.is_free(socket)}
    return {name: _plain(socket, one.read(socket)) for name, one in same.items()} if socket.kind != "menu" else {}


def _without_faces(graph: Graph) -> Iterator[str]:
    """A note about what the object shows beside its faces; Blender lists it as instances of the object."""
    made = graph.layer.depsgraph.object_instances
    kinds = {one.object.type for one in made if one.is_instance and one.parent.name == graph.obj.name}
    found = sorted({WITHOUT_FACES[kind] for kind in kinds & WITHOUT_FACES.keys()})
    if found:
        listed = " and ".join(found)
        yield f"{graph.obj.name!r} also has {listed}, left out until the node in brackets gives them faces."


def _notes(obj: Any, path: str, saved_by: Version) -> Iterator[str]:
    import bpy

    if saved_by > bpy.app.version[:2]:
        yield f"{path} was saved by Blender {saved_by[0]}.{saved_by[1]} and is read by {bpy.app.version_string}."
    if drivers := python_drivers(obj):
        yield f"Python drivers in {path} are never run; they would set {', '.join(sorted(set(drivers)))}."
    if len(modifiers(obj)) > 1:
        yield f"{obj.name!r} has several modifiers: {', '.join(m.name for m in modifiers(obj))}; --modifier chooses."
    others = [other.name for other in bpy.data.objects if other != obj and modifiers(other)]
    if others:
        yield f"Other objects with Geometry Nodes: {', '.join(others)}; --object chooses."


def _set_inputs(inputs: Inputs, settings: Iterable[Setting]) -> None:
    found = {socket.identifier: socket for socket in sockets(inputs.tree)}
    for identifier, component, value in settings:
        if identifier not in found:
            raise ValueError(f"The modifier has no input {identifier!r}.{did_you_mean(identifier, list(found))}")
        _set(inputs, found[identifier], component, value)


def _set(inputs: Inputs, socket: Socket, component: str, value: Value) -> None:
    """Give an input a value of exactly its own type, because Blender ignores any other."""
    if socket.kind == "menu":
        return inputs.write(socket, str(value))
    number = CASTS[socket.kind](float(value) / _scale(socket))
    if component:
        vector = list(inputs.read(socket))
        vector[COMPONENTS.index(component)] = number
        return inputs.write(socket, vector)
    return inputs.write(socket, number)


def _read(mesh: Any, matrix: np.ndarray, name: str) -> Mesh:
    """The surface of a Blender mesh in world axes; Blender gives None for a curve object that shows nothing."""
    if mesh is None or not mesh.polygons:
        raise ValueError(
            f"The object {name!r} has no faces. Curves and points alone are no surface: give them some in its "
            "nodes, with Curve to Mesh or Instance on Points."
        )
    mesh.calc_loop_triangles()
    vertices, faces = np.empty(3 * len(mesh.vertices), np.float32), np.empty(3 * len(mesh.loop_triangles), np.int32)
    slots, polygon = np.empty((2, len(mesh.loop_triangles)), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loop_triangles.foreach_get("vertices", faces)
    mesh.loop_triangles.foreach_get("material_index", slots)
    mesh.loop_triangles.foreach_get("polygon_index", polygon)
    parts, part_of = _parts(mesh, slots, name)
    triangles = faces.reshape(-1, 3)[:, :: -1 if np.linalg.det(matrix[:3, :3]) < 0 else 1]
    world = vertices.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    return compact(sort_faces(make_mesh(world, triangles, part_of, parts, pairs(polygon))))


def _parts(mesh: Any, slots: np.ndarray, name: str) -> tuple[tuple[str, ...], np.ndarray]:
    """The names of the parts that have faces, and the part of each face; without material it has the object's name."""
    named = dict(enumerate(material.name if material else name for material in mesh.materials))
    used = {int(slot): named.get(int(slot), name) for slot in np.unique(slots)}
    parts = tuple(dict.fromkeys(used.values()))
    part_of = np.zeros(max(used) + 1, np.uint8)
    part_of[list(used)] = [parts.index(part) for part in used.values()]
    return parts, part_of[slots]
