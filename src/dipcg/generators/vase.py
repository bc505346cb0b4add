"""Infinigen's vase with the paper's 12 parameters.

A thin adapter: Infinigen's function makes the node graph once in each process with its numbers as inputs, and a build
sets these inputs.

What the parameters do:
- `dimension_x` is half the width of the body, because the factory scales a profile of radius 1 by it.
- The height is less than `dimension_z` by one sixty-third of the outline, because the factory deletes the uppermost
  ring. It is more where the neck reaches beyond the top (`neck_position`, or `neck_mid_position` above 1) and the lip
  turns down.
- `profile_inner_radius` above 1 counts as 1, a smooth vase. The factory draws a smooth vase half of the time.
- The outline has 64 corners, so that a star with many points becomes an irregular pattern of flutes.
- The vase is turned by 90°, so that a star with an odd number of points is also its own mirror image.

Sources: Infinigen Indoors (Raistrick et al. 2024) for the factory, DI-PCG's published parameters for list and ranges.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from dipcg.blender.infinigen import (
    evaluated,
    graph_object,
    import_infinigen,
    new_graph,
    read_piece,
    set_inputs,
    silence,
)
from dipcg.camera import ViewRange
from dipcg.mesh import Mesh, join
from dipcg.space import Choice, ParameterSpace, Params, Real

space = ParameterSpace(
    Real("dimension_x", 0.05, 0.4, unit="m", doc="from the axis to the widest place", group="body"),
    Real("dimension_z", 0.2, 0.8, unit="m", doc="height", group="body"),
    Real("neck_scale", 0.15, 0.8, unit="of body", doc="width of the neck", group="neck"),
    Real("profile_inner_radius", 0.8, 1.2, unit="×", doc="depth of the flutes, none above 1", group="profile"),
    Choice("profile_star_points", (*range(2, 11), 16, *range(18, 31, 2)), doc="number of flutes", group="profile"),
    Real("top_scale", 0.6, 1.4, unit="of neck", doc="width of the mouth", group="neck"),
    Real(
        "neck_mid_position",
        0.5,
        1.5,
        unit="of the neck's height",
        doc="height at which the width is halfway to that of the mouth",
        group="neck",
    ),
    Real("neck_position", -0.2, 0.2, unit="of height", doc="how far the neck is raised", group="neck"),
    Real("shoulder_position", 0.1, 0.8, unit="of foot to neck", doc="height of the widest place", group="body"),
    Real("shoulder_thickness", 0.1, 0.3, unit="of foot to neck", doc="half the height of the belly", group="body"),
    Real("foot_scale", 0.2, 0.8, unit="of body", doc="width of the foot", group="foot"),
    Real("foot_height", 0.01, 0.1, unit="of height", doc="height of the foot", group="foot"),
)
# What people read for the names of Infinigen.
labels = {
    "dimension_x": "radius", "dimension_z": "height", "neck_scale": "width",
    "profile_inner_radius": "depth of the flutes", "profile_star_points": "flutes", "top_scale": "width of the mouth",
    "neck_mid_position": "middle of the flare", "neck_position": "rise",
    "shoulder_position": "height of the widest place", "shoulder_thickness": "height of the belly",
    "foot_scale": "width",
}  # fmt: skip
views = ViewRange(azimuth_deg=(-45, 45), elevation_deg=(-5, 50))
needs = ("infinigen", "bpy")

_MODULE = "infinigen.assets.objects.table_decorations.vase"
# The resolution and the thickness of the wall in metres are those of the factory.
_RESOLUTION = {"U_resolution": 64, "V_resolution": 64}
_THICKNESS = 0.002


@functools.cache
def prepare() -> Any:
    """Import Infinigen and make the node graph that all builds use, as an object with a wall and a smooth surface."""
    module = import_infinigen(_MODULE)
    inputs = {name: type(value) for name, value in _inputs(space.decode(np.zeros(len(space)))).items()}
    with silence():
        graph = new_graph(module.geometry_vases, inputs, Material=None, **_RESOLUTION)
    obj = graph_object(graph)
    obj.modifiers.new("wall", "SOLIDIFY").thickness = _THICKNESS
    obj.modifiers.new("smooth", "SUBSURF")
    return obj


def build(params: Params) -> Mesh:
    """The full mesh of the vase."""
    return _build(params, levels=2, wall=True)


def build_light(params: Params) -> Mesh:
    """The outer face of the wall alone, with a quarter of the points, which lie on the same smooth surface."""
    return _build(params, levels=1, wall=False)


def _build(params: Params, levels: int, wall: bool) -> Mesh:
    obj = prepare()
    set_inputs(obj, _inputs(params))
    obj.modifiers["smooth"].levels = levels
    obj.modifiers["wall"].show_viewport = wall
    with silence():
        body = read_piece("body", evaluated(obj))
    return join([body._replace(vertices=body.vertices[:, [1, 0, 2]] * [1, -1, 1])])


def _inputs(p: Any) -> dict[str, float]:
    """The inputs of the graph, in its own units, from the parameters."""
    return {
        "Profile Inner Radius": min(p["profile_inner_radius"], 1.0),
        "Profile Star Points": p["profile_star_points"],
        "Height": p["dimension_z"],
        "Diameter": p["dimension_x"],
        "Top Scale": p["neck_scale"] * p["top_scale"],
        "Neck Mid Position": p["neck_mid_position"],
        "Neck Position": 0.5 * p["neck_scale"] + 0.5 + p["neck_position"],
        "Neck Scale": p["neck_scale"],
        "Shoulder Position": p["shoulder_position"],
        "Shoulder Thickness": p["shoulder_thickness"],
        "Foot Scale": p["foot_scale"],
        "Foot Height": p["foot_height"],
    }
