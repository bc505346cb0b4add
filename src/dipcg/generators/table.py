"""Infinigen's dining table with the paper's 19 parameters.

A thin adapter: Infinigen's functions make the node graphs once in each process, and a build sets values on their nodes.

What the parameters do:
- `leg_number` is the number of stands. 4 is what Infinigen's graph makes of the published third option. A table with
  another style of legs has two square frames or four straight legs at each value.
- `top_scale` and `bottom_scale` have no effect on stands, because a single stand is in the middle. Several stands are
  upright, at the middle of the range of the factory.
- A round top (`ngon` 36) has no rounded corners and encloses the rectangle of its dimensions. A negative
  `top_profile_fillet_ratio` gives sharp corners. A large one is limited by the shorter side.
- `leg_height` is a factor of the space below the top. In Infinigen legs end above or below the floor at other values
  than 1. Here the table always stands on the floor, and `strecher_relative_pos` is measured from the top of the real
  leg, because stretchers would otherwise hang below short legs.
- `strecher_increament` 0 means no stretchers, where Infinigen leaves discs without height. 1 and 2 both close square
  frames at the bottom. Between four legs 1 joins neighbours and 2 joins diagonals.
- The two fills of the top have vertices of their own along its rim, with slits between. They are made again by
  `blender/caps.py`.
- Thick legs would come through a thin top, so that the top is raised until it hides their ends.

Sources: Infinigen Indoors (Raistrick et al. 2024) for the factory, DI-PCG's published parameters for list and ranges.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np

from dipcg.blender.caps import recapped
from dipcg.blender.infinigen import (
    evaluated,
    find_node,
    graph_object,
    graph_of,
    import_infinigen,
    read_piece,
    set_inputs,
    set_node,
    silence,
)
from dipcg.camera import ViewRange
from dipcg.mesh import Mesh, Solid, join
from dipcg.mesh.simplify import simplify
from dipcg.space import Choice, ParameterSpace, Params, Real

_STANDS = {"leg_style": ("single-stand",)}
_STRAIGHT = {"leg_style": ("straight",)}
_CURVED = {"leg_style": ("single-stand", "straight")}
_APART = {"leg_style": ("square", "straight")}

space = ParameterSpace(
    Choice("ngon", (4, 36), doc="of the top", group="top", labels=("rectangle", "round")),
    Real("dimension_x", 0.9, 2.2, unit="m", doc="of the top; of a round one, the rectangle in it", group="top"),
    Real("dimension_y", 0.9, 2.2, unit="m", doc="of the top; of a round one, the rectangle in it", group="top"),
    Real("dimension_z", 0.5, 0.9, unit="m", doc="height, if leg_height is 1", group="leg"),
    Choice("leg_style", ("single-stand", "square", "straight"), doc="stands, two frames or four legs", group="leg"),
    Choice("leg_number", (1, 2, 4), doc="number of stands", group="leg", when=_STANDS),
    Choice("leg_ngon", (4, 12), doc="of a leg", group="leg", when=_STRAIGHT, labels=("square", "round")),
    Real("leg_diameter", 0.0, 1.0, unit="share", doc="0.05 to 0.25 m; of a stand, 0.2 to 0.4 of x", group="leg"),
    Real("leg_height", 0.6, 2.0, unit="×", doc="length of the legs below the top", group="leg"),
    Real("leg_curve_ctrl_pts0", 0.0, 1.0, unit="share", doc="width of a stand at the top", group="leg", when=_STANDS),
    Real("leg_curve_ctrl_pts1", 0.0, 1.0, unit="share", doc="width halfway down", group="leg", when=_CURVED),
    Real(
        "leg_curve_ctrl_pts2",
        0.0,
        1.0,
        unit="share",
        doc="width at the bottom; of a stand, above its foot",
        group="leg",
        when=_CURVED,
    ),
    Real("top_scale", 0.6, 0.8, unit="of the top", doc="how far apart legs are", group="leg", when=_APART),
    Real("bottom_scale", 0.9, 1.3, unit="×", doc="how much farther apart their feet are", group="leg", when=_APART),
    Real("top_thickness", 0.02, 0.1, unit="m", doc="of the top", group="top"),
    Real(
        "top_profile_fillet_ratio",
        -0.6,
        0.6,
        unit="of 1.4 x",
        doc="radius of the corners, none below 0",
        group="top",
        when={"ngon": (4,)},
    ),
    Real("top_vertical_fillet_ratio", 0.0, 0.2, unit="of thickness", doc="bulge of the edge", group="top"),
    Real(
        "strecher_relative_pos",
        0.15,
        0.8,
        unit="of leg",
        doc="stretchers below the top",
        group="stretcher",
        when=_STRAIGHT | {"strecher_increament": (1, 2)},
    ),
    Choice(
        "strecher_increament",
        (0, 1, 2),
        doc="1 and 2 close square frames",
        group="stretcher",
        when=_APART,
        labels=("none", "around", "across"),
    ),
)
# What people read for the names of Infinigen.
labels = {
    "ngon": "shape", "dimension_x": "width", "dimension_y": "depth", "dimension_z": "height", "leg_style": "style",
    "leg_number": "stands", "leg_ngon": "cross-section", "leg_height": "length",
    "leg_curve_ctrl_pts0": "width at the top", "leg_curve_ctrl_pts1": "width in the middle",
    "leg_curve_ctrl_pts2": "width at the bottom", "top_scale": "distance apart",
    "bottom_scale": "distance of the feet", "top_profile_fillet_ratio": "roundness of corners",
    "top_vertical_fillet_ratio": "bulge of the edge", "strecher_relative_pos": "place",
    "strecher_increament": "stretchers",
}  # fmt: skip
# A table that is turned by 90° can look like another one with x and y exchanged. Views from a quarter turn show only
# one of the two.
views = ViewRange(azimuth_deg=(-45, 45), elevation_deg=(-5, 55))
needs = ("infinigen", "bpy", "manifold3d")

_MODULE = "infinigen.assets.objects.tables.dining_table"
# The points at which a leg's width is set, as shares of its length, for each style.
_BENDS = {"single-stand": (0.0, 0.5, 0.9, 1.0), "square": (), "straight": (0.0, 0.4, 1.0)}
# The number of triangles of a light top, so that enough remain for the legs.
_TOP_FACES = 600
# The number of sides of light stands, by the number of stands. Simplification would make corners of their wide, thin
# feet, so that light stands are built with few sides and are not simplified.
_STAND_SIDES = {1: 40, 2: 28, 4: 20}
# The share of the top's thickness that legs may reach into.
_COVER = 0.9
# The scale at which Infinigen places several stands on average.
_STAND_SCALE = 0.65


@functools.cache
def prepare() -> tuple[Any, dict[str, Any]]:
    """Import Infinigen and make the node graphs that all builds use, as objects: a top, and legs for each style."""
    module = import_infinigen(_MODULE)
    with silence():
        legs = {style: module.geometry_create_legs(**_example(module, style)) for style in _BENDS}
        top = module.nodegroup_generate_table_top()
    return graph_object(top), {style: graph_object(graph) for style, graph in legs.items()}


def build(params: Params) -> Mesh:
    """The full mesh of the table, which stands on the floor."""
    return _build(params, light=False)


def build_light(params: Params) -> Mesh:
    """A coarser mesh: fewer rings along legs, stretchers and the top's edge, fewer sides of stands and stretchers."""
    return _build(params, light=True)


def _example(module: Any, style: str) -> dict[str, Any]:
    """Some parameters of the factory for a style; each build sets all that have an effect."""
    with module.FixedSeed(0):
        example = module.TableDiningFactory.sample_parameters((1.0, 1.0, 1.0))
    curve = [(bend, 1.0) for bend in _BENDS[style]]
    style = style.replace("-", "_")
    return example | {"Leg Style": style, "Leg Curve Control Points": curve, "TopMaterial": None, "LegMaterial": None}


def _build(p: Any, light: bool) -> Mesh:
    with silence():
        top, *legs = _pieces(p, light)
    space_below = p["dimension_z"] - p["top_thickness"]
    excess = max(0.0, legs[0][1][:, 2].max() - space_below - _COVER * p["top_thickness"])
    legs = [_raised(leg, (p["leg_height"] - 1) * space_below) for leg in legs]
    return join([_raised(top, p["leg_height"] * space_below + excess), *legs])


def _raised(piece: Solid, height: float) -> Solid:
    return piece._replace(vertices=piece.vertices + np.array([0, 0, height], np.float32))


def _pieces(p: Any, light: bool) -> Iterator[Solid]:
    top, legs = prepare()[0], prepare()[1][p["leg_style"]]
    set_inputs(top, _top(p))
    set_node(find_node(graph_of(top), "FILLET_CURVE"), {"Count": 1 if light else 8})
    piece = recapped(read_piece("top", evaluated(top)))
    yield _simplified(piece) if light else piece
    _set_legs(graph_of(legs), p, light)
    for part in ("leg", "stretcher") if _has_stretchers(p) else ("leg",):
        set_node(find_node(graph_of(legs), "nodegroup_create_legs_and_strechers"), _visible(part))
        yield read_piece(part, evaluated(legs))


def _simplified(piece: Solid) -> Solid:
    coarse = simplify(join([piece]), _TOP_FACES, error=0.0001)
    return Solid(piece.part, coarse.vertices, coarse.faces)


def _has_stretchers(p: Any) -> bool:
    return p["leg_style"] == "straight" and p["strecher_increament"] > 0


def _visible(part: str) -> dict[str, bool]:
    """The inputs that make the graph show the legs alone, or the stretchers alone."""
    stretchers = part == "stretcher"
    return {"Keep Legs": not stretchers, "Keep Odd Strechers": stretchers, "Keep Even Strechers": stretchers}


def _top(p: Any) -> dict[str, Any]:
    return {
        "Thickness": p["top_thickness"],
        "N-gon": p["ngon"],
        "Profile Width": 1.414 * p["dimension_x"],
        "Aspect Ratio": p["dimension_y"] / p["dimension_x"],
        "Fillet Ratio": p["top_profile_fillet_ratio"] if p["ngon"] == 4 else 0.0,
        "Fillet Radius Vertical": p["top_vertical_fillet_ratio"],
    }


def _set_legs(graph: Any, p: Any, light: bool) -> None:
    """Set the places of the legs and the shape of one leg."""
    stands, width = p["leg_style"] == "single-stand", 1.414 * p["dimension_x"]
    scale = _STAND_SCALE if stands else p["top_scale"]
    anchors = {"Profile Width": scale * width, "Profile Aspect Ratio": p["dimension_y"] / p["dimension_x"]}
    number = {"single-stand": p["leg_number"], "square": 2, "straight": 4}[p["leg_style"]]
    set_node(find_node(graph, "nodegroup_create_anchors"), anchors | {"Profile N-gon": number})
    placement = {
        "Table Height": p["dimension_z"] - p["top_thickness"],
        "Leg Bottom Relative Scale": 1.0 if stands else p["bottom_scale"],
        "Strecher Index Increment": p["strecher_increament"],
        "Strecher Relative Position": p["leg_height"] * p["strecher_relative_pos"],
    }
    set_node(find_node(graph, "nodegroup_create_legs_and_strechers"), placement)
    {"single-stand": _set_stand, "square": _set_square, "straight": _set_straight}[p["leg_style"]](graph, p, light)


def _set_stand(graph: Any, p: Any, light: bool) -> None:
    node, diameter = find_node(graph, "nodegroup_generate_single_stand"), 0.2 + 0.2 * p["leg_diameter"]
    size = {"Leg Height": p["leg_height"], "Leg Diameter": diameter * p["dimension_x"]}
    sides = _STAND_SIDES[p["leg_number"]] if light else 64
    set_node(node, size | {"Resolution": sides})
    set_node(find_node(node.node_tree, "nodegroup_n_gon_cylinder"), {"Profile Resolution": sides})
    a, b, c = (p[f"leg_curve_ctrl_pts{i}"] for i in range(3))
    _set_widths(node, (0.1 + 0.8 * a, 0.1 + 0.8 * b, 0.2 + 0.8 * c, 1.0))


def _set_square(graph: Any, p: Any, light: bool) -> None:
    frame = {
        "Height": p["leg_height"],
        "Width": 0.707 * 1.414 * p["top_scale"] * p["dimension_y"],
        "Has Bottom Connector": p["strecher_increament"] > 0,
        "Profile Width": _diameter(p),
    }
    set_node(find_node(graph, "nodegroup_generate_leg_square"), frame)


def _set_straight(graph: Any, p: Any, light: bool) -> None:
    node = find_node(graph, "nodegroup_generate_leg_straight")
    leg = {"Leg Height": p["leg_height"], "Leg Diameter": _diameter(p), "N-gon": p["leg_ngon"]}
    set_node(node, leg | {"Resolution": 12 if light else 32})
    set_node(find_node(node.node_tree, "nodegroup_n_gon_cylinder"), {"Profile Resolution": 32 if light else 64})
    _set_widths(node, (1.0, 0.5 + 0.5 * p["leg_curve_ctrl_pts1"], 0.3 + 0.5 * p["leg_curve_ctrl_pts2"]))
    stretcher = find_node(graph, "nodegroup_strecher")
    set_node(stretcher, {"Profile Width": 0.5 * _diameter(p)})
    cylinder = find_node(stretcher.node_tree, "nodegroup_n_gon_cylinder")
    set_node(cylinder, {"Profile Resolution": 16 if light else 64, "Resolution": 2 if light else 64})


def _diameter(p: Any) -> float:
    return 0.05 + 0.2 * p["leg_diameter"]


def _set_widths(leg: Any, widths: tuple[float, ...]) -> None:
    """Set the points of the curve that gives the width of a leg along its length."""
    radius = find_node(leg.node_tree, "nodegroup_generate_radius_curve")
    curve = find_node(radius.node_tree, "CURVE_FLOAT").mapping
    for point, width in zip(curve.curves[0].points, widths, strict=True):
        point.location = (point.location[0], width)
    curve.update()
    radius.node_tree.update_tag()
