"""Infinigen's basket with the paper's 14 parameters.

A thin adapter: Infinigen makes its node graph once in each process, and a build sets values on the nodes of the graph.
The graph ends in a boolean: a box minus its inside, two sets of bars for the holes and one bar for the handles. The
adapter reads these solids from the graph, and Manifold subtracts them one after the other, which gives the same surface
many times faster.

Differences from Infinigen:
- Infinigen uses the default solver of Blender 4.2 for the boolean, which is not exact: a rounded basket can have a lid,
  and bars can stick out. Here the surface equals the result of Blender's exact solver.
- The factory cuts no holes into baskets lower than 0.12 m. Here they have holes, because the parameters of the holes
  would otherwise have no effect on a fifth of all baskets. Holes form whole rows and columns. A wall that has no room
  for one between its edges has none.
- A basket turned by 180°, or mirrored, is the same basket. A build draws no random numbers.

Sources: Infinigen Indoors (Raistrick et al. 2024) for the factory, DI-PCG's published parameters for list and ranges,
Manifold (Lalish 2020-2025, PyPI `manifold3d`) for the boolean.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np

from dipcg.blender.infinigen import (
    find_node,
    graph_object,
    graph_of,
    import_infinigen,
    read_socket,
    replaced,
    silence,
)
from dipcg.camera import ViewRange
from dipcg.mesh import Mesh, make_mesh
from dipcg.space import Choice, ParameterSpace, Params, Real

_OFF_ON = (False, True)
_HANDLE = {"has_handle": (True,)}
_HOLES = {"has_holes": (True,)}

space = ParameterSpace(
    Real("depth", 0.1, 0.6, unit="m", doc="along x, the side with the handles", group="frame"),
    Real("width", 0.1, 0.7, unit="m", doc="along y", group="frame"),
    Real("height", 0.05, 0.4, unit="m", doc="along z", group="frame"),
    Choice("frame_sub_level", (0, 3), doc="of the basket", group="frame", labels=("sharp box", "rounded box")),
    Real("thickness", 0.001, 0.03, unit="m", doc="of two walls; of the bottom, a quarter", group="frame"),
    Choice("has_handle", _OFF_ON, doc="openings to grip in two opposite walls", group="handle"),
    Choice("handle_sub_level", (0, 1, 2), doc="how round the openings are", group="handle", when=_HANDLE),
    Real("handle_depth", 0.2, 0.6, unit="of depth", doc="length of an opening", group="handle", when=_HANDLE),
    Real("handle_height", 0.1, 0.3, unit="of height", doc="height of an opening", group="handle", when=_HANDLE),
    Real("handle_dist_to_top", 0.08, 0.4, unit="of height", doc="wall above an opening", group="handle", when=_HANDLE),
    Choice("has_holes", _OFF_ON, doc="small square holes in all four walls", group="holes"),
    Real("hole_gap_size", 0.5, 2.0, unit="of hole size", doc="least gap between holes", group="holes", when=_HOLES),
    Real("hole_edge_gap", 0.04, 0.1, unit="m", doc="edges without holes, both together", group="holes", when=_HOLES),
    Real("hole_size", 0.007, 0.02, unit="m", doc="side of a hole", group="holes", when=_HOLES),
)
# What people read for the names of Infinigen.
labels = {
    "frame_sub_level": "shape", "has_handle": "openings to grip", "handle_sub_level": "roundness",
    "handle_depth": "length", "handle_dist_to_top": "distance from the top", "has_holes": "holes in the walls",
    "hole_gap_size": "gap between holes", "hole_edge_gap": "edges without holes", "hole_size": "size of a hole",
}  # fmt: skip
# Half a turn shows all sides, because a basket turned by 180° is the same basket.
views = ViewRange(azimuth_deg=(-90, 90), elevation_deg=(0, 60))
_QUARTER_TURN = ViewRange(azimuth_deg=(-45, 45), elevation_deg=(0, 60))
needs = ("infinigen", "bpy", "manifold3d")
recycle_after = 1000

_MODULE = "infinigen.assets.objects.organizer.basket"


def views_of(params: Params) -> ViewRange:
    """Half a turn with handles, and a quarter turn without.

    A basket without handles looks like one with width and depth exchanged that is turned by 90°.
    """
    return views if params["has_handle"] else _QUARTER_TURN


@functools.cache
def prepare() -> Any:
    """Import Infinigen and make the node graph that all builds use, as an object."""
    import manifold3d  # noqa: F401

    module = import_infinigen(_MODULE)
    make = module.node_utils.to_nodegroup("basket")(module.geometry_nodes)
    every = {p.name: p.inactive for p in space} | {"has_handle": True, "has_holes": True}
    with silence(), replaced(module.surface, shaderfunc_to_material=lambda *args: None):
        return graph_object(make(**_attributes(every)))


def build(params: Params) -> Mesh:
    """The full mesh of the basket, which stands on the floor."""
    obj, p = prepare(), dict[str, Any](params)
    _set_values(obj, _attributes(p))
    frame, *cutters = (_solid(obj, socket) for socket in _sockets(graph_of(obj), p))
    mesh = functools.reduce(_subtract, cutters, frame).to_mesh()
    vertices = mesh.vert_properties + np.array([0, 0, p["height"] / 2])
    return make_mesh(vertices, mesh.tri_verts, part_names=("frame",))


def _subtract(solid: Any, cutter: Any) -> Any:
    difference = solid - cutter
    # Reading the result makes Manifold evaluate it now. Evaluated later, it would first unite the cutters, whose bars
    # cross a hundred times inside the basket.
    difference.num_tri()
    return difference


def _solid(obj: Any, socket: Any) -> Any:
    import manifold3d

    _, vertices, faces, *_ = read_socket("frame", obj, socket)
    solid = manifold3d.Manifold(manifold3d.Mesh(np.ascontiguousarray(vertices), faces.astype(np.uint32)))
    # Triangles in one plane are merged, because each of them would be cut alone.
    return solid.simplify(0.0)


def _sockets(graph: Any, p: Any) -> Iterator[Any]:
    """The sockets of the graph with the solid box, and then with its inside, its holes and its handles."""
    boolean = find_node(graph, "MESH_BOOLEAN")
    yield boolean.inputs["Mesh 1"].links[0].from_socket
    cutters = [link.from_socket for link in boolean.inputs["Mesh 2"].links]
    yield next(socket for socket in cutters if socket.node.type != "GROUP")
    if p["has_holes"]:
        yield from find_node(graph, "nodegroup_holes").outputs
    if p["has_handle"]:
        yield from find_node(graph, "nodegroup_handle_hole").outputs


def _set_values(obj: Any, attributes: dict[str, Any]) -> None:
    nodes = graph_of(obj).nodes
    for name, label in _LABELS.items():
        nodes[label].outputs[0].default_value = attributes[name]
    for name, label in (("frame_sub_level", "sub_level"), ("handle_sub_level", "handle_level")):
        nodes[label].integer = attributes[name]
    obj.update_tag()


# The labels of the nodes that hold a value, by the names in `_attributes`.
_LABELS = {name: name for name in ("depth", "width", "height", "thickness", "hole_edge_gap", "hole_size")} | {
    "hole_gap_size": "gap_size",
    "handle_depth": "hole_depth",
    "handle_height": "hole_height",
    "handle_dist_to_top": "hole_dist",
}


def _attributes(p: Any) -> dict[str, Any]:
    """The parameters with the factory's names for them, and lengths in metres."""
    return dict(p) | {
        "handle_depth": p["handle_depth"] * p["depth"],
        "handle_height": p["handle_height"] * p["height"],
        "handle_dist_to_top": (p["handle_height"] / 2 + p["handle_dist_to_top"]) * p["height"],
        "hole_gap_size": p["hole_gap_size"] * p["hole_size"],
    }
