"""Make `lamp.blend`: a lamp in Geometry Nodes with an input of every kind, for `dipcg generators add`.

Run with `python examples/make_lamp.py [FILE]`; needs Blender's module (`pip install 'dipcg[infinigen]'`).
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import bpy

TARGET = Path(__file__).with_name("lamp.blend")
COLOURS = {"base": (0.05, 0.05, 0.06, 1), "stem": (0.7, 0.5, 0.2, 1), "shade": (0.9, 0.82, 0.68, 1)}
# In metres.
THICKNESS = 0.004
# A corner of the shade lies on the Y axis, so that left and right are alike.
TURNED = (0, 0, math.pi / 2)

# Panel, name, type, lowest, highest, default, subtype, description
INPUTS = [
    ("base", "Base Shape", "Menu", None, None, "Round", "", "outline of the base"),
    ("base", "Base Radius", "Float", 0.08, 0.14, 0.1, "DISTANCE", "half the width of the base"),
    ("base", "Base Height", "Float", 0.01, 0.05, 0.02, "DISTANCE", "of the base"),
    ("stem", "Height", "Float", None, None, 0.4, "DISTANCE", "length of the stem"),
    ("stem", "Stem Radius", "Float", 0.005, 0.012, 0.008, "DISTANCE", "of the stem"),
    ("stem", "Lean", "Float", -math.radians(35), math.radians(35), 0.0, "ANGLE", "of the stem, towards +X"),
    ("stem", "Rings", "Int", 0, 4, 2, "NONE", "balls on the stem"),
    ("shade", "Shade", "Menu", None, None, "Cone", "", "what covers the bulb"),
    ("shade", "Shade Radius", "Float", 0.1, 0.2, 0.15, "DISTANCE", "at its widest"),
    ("shade", "Shade Height", "Float", 0.1, 0.22, 0.16, "DISTANCE", "from rim to top"),
    ("shade", "Taper", "Float", 0.2, 1.0, 0.6, "FACTOR", "upper over lower radius of a cone"),
    ("shade", "Sides", "Int", 5, 40, 32, "NONE", "flat sides around the shade"),
    ("shade", "Shade Offset", "Vector", -0.04, 0.04, (0, 0, 0), "TRANSLATION", "of the shade from the end of the stem"),
    ("shade", "Finial", "Bool", None, None, True, "", "a ball on top"),
    ("shade", "Shade Material", "Material", None, None, None, "", "of the shade"),
]


class Graph:
    """A node group and a short way to put nodes into it."""

    def __init__(self, name: str) -> None:
        self.tree: Any = bpy.data.node_groups.new(name, "GeometryNodeTree")
        self.tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        panels = {panel: self.tree.interface.new_panel(panel.capitalize()) for panel, *_ in INPUTS}
        for panel, name, kind, *_ in INPUTS:
            socket = f"NodeSocket{kind}"
            self.tree.interface.new_socket(name, in_out="INPUT", socket_type=socket, parent=panels[panel])
        self.inputs = self.tree.nodes.new("NodeGroupInput").outputs

    def add(self, kind: str, *values: Any, **settings: Any) -> Any:
        """A node with its attributes and the values of, or links to, its inputs in order; None leaves one alone."""
        node = self.tree.nodes.new(kind)
        for key, value in settings.items():
            setattr(node, key, value)
        for socket, value in zip([s for s in node.inputs if s.enabled], values, strict=False):
            self.put(value, socket)
        return node

    def put(self, value: Any, socket: Any) -> None:
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, bpy.types.NodeSocket):
                self.tree.links.new(one, socket)
            elif one is not None:
                socket.default_value = one

    def make(self, kind: str, *values: Any, **settings: Any) -> Any:
        """The first visible output of a new geometry node."""
        node = self.add(f"GeometryNode{kind}", *values, **settings)
        return next(socket for socket in node.outputs if socket.enabled)

    def math(self, operation: str, *values: Any) -> Any:
        return self.add("ShaderNodeMath", *values, operation=operation).outputs[0]

    def vector(self, x: Any = 0.0, y: Any = 0.0, z: Any = 0.0) -> Any:
        return self.add("ShaderNodeCombineXYZ", x, y, z).outputs[0]

    def move(self, mesh: Any, translation: Any = None, rotation: Any = None, scale: Any = None) -> Any:
        node = self.add("GeometryNodeTransform", mesh)
        for name, value in (("Translation", translation), ("Rotation", rotation), ("Scale", scale)):
            self.put(value, node.inputs[name])
        return node.outputs[0]

    def join(self, *meshes: Any) -> Any:
        return self.make("JoinGeometry", list(meshes))

    def paint(self, mesh: Any, material: Any) -> Any:
        node = self.add("GeometryNodeSetMaterial", mesh)
        self.put(material, node.inputs["Material"])
        return node.outputs[0]

    def menu(self, choice: Any, **meshes: Any) -> Any:
        node = self.tree.nodes.new("GeometryNodeMenuSwitch")
        node.data_type = "GEOMETRY"
        node.enum_items.clear()
        for name in meshes:
            node.enum_items.new(name)
        self.put(choice, node.inputs[0])
        for name, mesh in meshes.items():
            self.put(mesh, node.inputs[name])
        return node.outputs[0]


def main() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    materials = {name: material(name, colour) for name, colour in COLOURS.items()}
    graph = Graph("Lamp")
    stem, end, lean = make_stem(graph, materials["stem"])
    pieces = (make_base(graph, materials["base"]), stem, make_shade(graph, end, lean, materials["stem"]))
    graph.add("NodeGroupOutput", graph.join(*pieces))
    describe_inputs(graph)
    obj = bpy.data.objects.new("Lamp", bpy.data.meshes.new("Lamp"))
    bpy.context.scene.collection.objects.link(obj)
    modifier: Any = obj.modifiers.new("Lamp", "NODES")
    modifier.node_group = graph.tree
    by_name = {item.name: item.identifier for item in graph.tree.interface.items_tree if item.item_type == "SOCKET"}
    modifier[by_name["Shade Material"]] = materials["shade"]
    # Blender would write lamp.blend1 beside it.
    bpy.context.preferences.filepaths.save_version = 0
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else TARGET
    bpy.ops.wm.save_as_mainfile(filepath=str(target.resolve()), compress=True)


def material(name: str, colour: tuple[float, ...]) -> Any:
    made: Any = bpy.data.materials.new(name)
    made.diffuse_color = colour
    return made


def describe_inputs(graph: Graph) -> None:
    """Limits, defaults, subtypes and descriptions; menus know their items only once they are linked."""
    items = {item.name: item for item in graph.tree.interface.items_tree if item.item_type == "SOCKET"}
    for _, name, _, low, high, default, subtype, description in INPUTS:
        item = items[name]
        item.description = description
        if subtype:
            item.subtype = subtype
        if low is not None:
            item.min_value, item.max_value = low, high
        if default is not None:
            item.default_value = default


def make_base(graph: Graph, paint: Any) -> Any:
    radius, height = graph.inputs["Base Radius"], graph.inputs["Base Height"]
    double = graph.math("MULTIPLY", radius, 2.0)
    disc = graph.make("MeshCylinder", 64, 1, 1, radius, height)
    block = graph.make("MeshCube", graph.vector(double, double, height))
    base = graph.menu(graph.inputs["Base Shape"], Round=disc, Square=block)
    return graph.paint(graph.move(base, graph.vector(z=graph.math("MULTIPLY", height, 0.5))), paint)


def make_stem(graph: Graph, paint: Any) -> tuple[Any, Any, Any]:
    """The stem with its balls, where it ends, and how it is turned there."""
    height, radius, lean = (graph.inputs[name] for name in ("Height", "Stem Radius", "Lean"))
    start = graph.inputs["Base Height"]
    across, up = (graph.math("MULTIPLY", height, graph.math(f, lean)) for f in ("SINE", "COSINE"))
    end = graph.vector(x=across, z=graph.math("ADD", start, up))
    middle = graph.vector(z=graph.math("MULTIPLY_ADD", height, 0.6, start))
    curve = graph.make("CurveQuadraticBezier", 24, graph.vector(z=start), middle, end)
    tube = graph.make("CurveToMesh", curve, graph.make("CurvePrimitiveCircle", 16, radius), True)
    rings = graph.inputs["Rings"]
    ball = graph.make("MeshUVSphere", 20, 12, graph.math("MULTIPLY", radius, 2.4))
    share = graph.math("DIVIDE", graph.math("ADD", graph.make("InputIndex"), 1.0), graph.math("ADD", rings, 1.0))
    along = graph.add("GeometryNodeSampleCurve", mode="FACTOR", use_all_curves=True)
    graph.put(curve, along.inputs["Curves"])
    graph.put(share, along.inputs["Factor"])
    points = graph.make("SetPosition", graph.make("MeshLine", rings), None, along.outputs["Position"])
    balls = graph.add("GeometryNodeInstanceOnPoints", points)
    graph.put(ball, balls.inputs["Instance"])
    return graph.paint(graph.join(tube, balls.outputs[0]), paint), end, graph.vector(y=lean)


def make_shade(graph: Graph, end: Any, lean: Any, finial_paint: Any) -> Any:
    radius, height, sides = (graph.inputs[name] for name in ("Shade Radius", "Shade Height", "Sides"))
    top = graph.math("MULTIPLY", radius, graph.inputs["Taper"])
    half = graph.math("MULTIPLY", height, -0.5)
    cone = graph.move(graph.make("MeshCone", sides, 1, top, radius, height, fill_type="NONE"), graph.vector(z=half))
    ball = graph.make("MeshUVSphere", sides, 24, 1.0)
    low = graph.add("FunctionNodeCompare", operation="LESS_THAN", data_type="FLOAT")
    graph.put(graph.add("ShaderNodeSeparateXYZ", graph.make("InputPosition")).outputs["Z"], low.inputs["A"])
    graph.put(-0.01, low.inputs["B"])
    bowl = graph.make("DeleteGeometry", ball, low.outputs[0], domain="POINT")
    dome = graph.move(
        bowl, graph.vector(z=graph.math("MULTIPLY", height, -1.0)), None, graph.vector(radius, radius, height)
    )
    small = graph.math("MULTIPLY", radius, 0.6)
    globe = graph.move(
        ball, graph.vector(z=graph.math("MULTIPLY", small, -1.0)), None, graph.vector(small, small, small)
    )
    shade = graph.menu(graph.inputs["Shade"], Cone=shell(graph, cone), Dome=shell(graph, dome), Globe=globe)
    shade = graph.paint(graph.move(shade, None, TURNED), graph.inputs["Shade Material"])
    rod = graph.make("MeshCylinder", 16, 1, 1, graph.inputs["Stem Radius"], 0.1)
    knob = graph.move(graph.make("MeshUVSphere", 20, 12, 0.016), graph.vector(z=0.03))
    finial = graph.paint(graph.join(graph.move(rod, graph.vector(z=-0.02)), knob), finial_paint)
    shown = graph.make("Switch", graph.inputs["Finial"], None, finial, input_type="GEOMETRY")
    moved = graph.move(graph.join(shade, shown), graph.inputs["Shade Offset"])
    return graph.move(graph.move(moved, graph.vector(z=0.05)), end, lean)


def shell(graph: Graph, surface: Any) -> Any:
    """A surface given a thickness, inwards."""
    inside = graph.make("ExtrudeMesh", surface, None, None, -THICKNESS, False)
    return graph.make("MergeByDistance", graph.join(surface, inside))


if __name__ == "__main__":
    main()
