"""Functions for the adapters over Infinigen: a silent import, fixed draws, a clean Blender, meshes as arrays.

Every function here runs in a worker process, the only place where Blender is imported.
"""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np

from dipcg.mesh import Solid, pairs, triangulate
from dipcg.mesh.order import sort_triangles


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Discard everything that is written to file descriptors 1 and 2; Blender writes from C."""
    copies = [os.dup(1), os.dup(2)]
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        for target, saved in zip((1, 2), copies, strict=True):
            os.dup2(saved, target)
            os.close(saved)


def import_infinigen(module: str) -> ModuleType:
    """Import a module of Infinigen without its output and without access to the network."""
    with silence(), _one_thread():
        import bpy

        bpy.context.preferences.system.use_online_access = False
        bpy.context.preferences.edit.use_global_undo = False
        return importlib.import_module(module)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Let Blender count one processor while it starts: its threads cost more processor time than they save."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    every = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(every)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, every)


@contextlib.contextmanager
def replaced(target: Any, **replacements: Any) -> Iterator[None]:
    """Give attributes of a module other values for a while."""
    before = {name: getattr(target, name) for name in replacements}
    for name, value in replacements.items():
        setattr(target, name, value)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(target, name, value)


def middle(low: float = 0.0, high: float = 1.0, size: Any = None) -> Any:
    """Replaces `uniform` where a factory draws while it builds: the middle of the range."""
    value = (np.asarray(low) + np.asarray(high)) / 2
    return float(value) if size is None and value.ndim == 0 else np.broadcast_to(value, size or value.shape).copy()


def coarse_modifiers(butil: ModuleType, segments: int = 2) -> Any:
    """`modify_mesh` of Infinigen with fewer segments in its bevels, for light builds."""
    modify = butil.modify_mesh

    def modify_coarsely(obj: Any, kind: str, *args: Any, **settings: Any) -> Any:
        if kind == "BEVEL":
            settings["segments"] = segments
        return modify(obj, kind, *args, **settings)

    return modify_coarsely


def clean_blender() -> None:
    """Remove all data of earlier builds, because Blender becomes slower with each one."""
    import bpy

    data = bpy.data
    for blocks in (data.objects, data.meshes, data.curves, data.node_groups):
        data.batch_remove(blocks)


def graph_object(graph: Any) -> Any:
    """An object whose surface a node graph makes; it is evaluated again when a value in the graph has changed.

    Infinigen builds a graph for each asset. Building it once and setting other values takes a tenth of the time.
    """
    import bpy

    obj = bpy.data.objects.new(graph.name, bpy.data.meshes.new(graph.name))
    bpy.context.scene.collection.objects.link(obj)
    obj.modifiers.new("graph", "NODES").node_group = graph
    return obj


def new_graph(function: Any, inputs: dict[str, type], **fixed: Any) -> Any:
    """The node graph that a function of Infinigen makes; its arguments in `inputs` become inputs of the graph."""
    import bpy
    from infinigen.core.nodes.node_wrangler import Nodes, NodeWrangler

    graph = bpy.data.node_groups.new(function.__name__, "GeometryNodeTree")
    wrangler = NodeWrangler(graph)
    sockets = [("NodeSocketInt" if kind is int else "NodeSocketFloat", name, kind(0)) for name, kind in inputs.items()]
    entry = wrangler.new_node(Nodes.GroupInput, expose_input=sockets)
    function(wrangler, **{name: entry.outputs[name] for name in inputs}, **fixed)
    return graph


def set_inputs(obj: Any, values: dict[str, Any]) -> None:
    """Set inputs of the graph of a `graph_object` by their names."""
    modifier = obj.modifiers["graph"]
    for socket in modifier.node_group.interface.items_tree:
        if socket.in_out == "INPUT" and socket.name in values:
            value = values[socket.name]
            modifier[socket.identifier] = type(socket.default_value)(value) if np.isscalar(value) else value
    obj.update_tag()


def set_node(node: Any, values: dict[str, Any]) -> None:
    """Set inputs of a node by their names."""
    for name, value in values.items():
        node.inputs[name].default_value = value


def evaluated(obj: Any) -> Any:
    """The object after its modifiers; it must be read before Blender evaluates again."""
    import bpy

    return obj.evaluated_get(bpy.context.evaluated_depsgraph_get())


def graph_of(obj: Any) -> Any:
    """The node graph of a `graph_object`."""
    return obj.modifiers["graph"].node_group


def find_node(graph: Any, name: str) -> Any:
    """The first node of a type like FILLET_CURVE, or with the node group that Infinigen's function `name` makes."""
    groups = (node for node in graph.nodes if node.type == "GROUP" and node.node_tree.name.startswith(name))
    return next((node for node in graph.nodes if node.type == name), None) or next(groups)


def read_socket(part: str, obj: Any, socket: Any) -> Solid:
    """The geometry at a socket within the graph of a `graph_object`, in place of the output of the whole graph."""
    graph = graph_of(obj)
    shown = graph.nodes.get("shown") or graph.nodes.new("GeometryNodeRealizeInstances")
    shown.name = "shown"
    graph.links.new(shown.outputs[0], find_node(graph, "GROUP_OUTPUT").inputs[0])
    graph.links.new(socket, shown.inputs[0])
    return read_piece(part, evaluated(obj))


def read_piece(part: str, obj: Any) -> Solid:
    """A Blender object's mesh in world axes, triangles in an order of our own, of which two are a quad.

    Blender lists the faces of one and the same mesh in an order that depends on memory addresses.
    """
    mesh = obj.data
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    corners = np.empty(len(mesh.loops), np.int32)
    sizes = np.empty(len(mesh.polygons), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.polygons.foreach_get("loop_total", sizes)
    matrix = np.array(obj.matrix_basis, np.float32)
    triangles, polygon = triangulate(sizes, corners)
    triangles, order = sort_triangles(triangles)
    quads = pairs(polygon[order].astype(np.int32))
    return Solid(part, vertices.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3], triangles, quads)
