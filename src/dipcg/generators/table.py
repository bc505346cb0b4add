"""Infinigen's dining table with the paper's 19 parameters.

A thin adapter: Infinigen's functions make the node graphs once in each process, and a build sets values on their nodes.
Where the published parameters say nothing or too much, this is what they do here:

- `leg_number` counts stands, four being what Infinigen's graph makes of the published third option; a table has two
  square frames or four straight legs, whatever it says.
- `top_scale` and `bottom_scale` do nothing for stands, for a single one stands in the middle: more of them stand where
  Infinigen's middle draw puts them, upright.
- A round top (`ngon` 36) has no rounded corners, and goes around the rectangle that its dimensions give. A negative
  `top_profile_fillet_ratio` is a sharp corner, as a large one is limited by the shorter side.
- `leg_height` is a factor to the room below the top. Other than 1 it had legs end above or below the floor; here the
  table always stands on it, and `strecher_relative_pos` counts from the top of the real leg, or stretchers would hang
  in the air below short ones. 0 for `strecher_increament` is no stretcher, where Infinigen leaves discs without height.
- The top's two fills have corners of their own along its rim, with slits between: they are made anew (`_caps.py`).
- Thick legs would come through a thin top: it is raised until it hides their ends.
- 1 and 2 of `strecher_increament` both close square frames at the bottom; of four legs they join neighbours, diagonals.

Sources: Infinigen Indoors (Raistrick et al. 2024) for the factory, DI-PCG's published parameters for list and ranges.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np

from dipcg.blender.caps import recapped
from dipcg.blender.infinigen import (
    Piece,
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
from dipcg.mesh import Mesh, join, simplify
from dipcg.space import Choice, ParameterSpace, Params, Real

_STANDS = {"leg_style": ("single-stand",)}
_STRAIGHT = {"leg_style": ("straight",)}
_CURVED = {"leg_style": ("single-stand", "straight")}
_APART = {"leg_style": ("square", "straight")}

space = ParameterSpace(
    Choice("ngon", (4, 36), doc="corners of the top: a rectangle or round", group="top"),
    Real("dimension_x", 0.9, 2.2, unit="m", doc="of the top; of a round one, the rectangle in it", group="top"),
    Real("dimension_y", 0.9, 2.2, unit="m", doc="of the top; of a round one, the rectangle in it", group="top"),
    Real("dimension_z", 0.5, 0.9, unit="m", doc="height, if leg_height is 1", group="leg"),
    Choice("leg_style", ("single-stand", "square", "straight"), doc="stands, two frames or four legs", group="leg"),
    Choice("leg_number", (1, 2, 4), doc="number of stands", group="leg", when=_STANDS),
    Choice("leg_ngon", (4, 12), doc="corners of a straight leg", group="leg", when=_STRAIGHT),
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
        doc="stretchers: none, around, across; 1 and 2 close square frames",
        group="stretcher",
        when=_APART,
    ),
)
# Turned by 90°, four legs are those of another table, with x and y exchanged: no view of one is to be one of the other.
views = ViewRange(azimuth_deg=(-45, 45), elevation_deg=(-5, 55))
needs = ("infinigen", "bpy", "manifold3d")

_MODULE = "infinigen.assets.objects.tables.dining_table"


_BENDS = {"single-stand": (0.0, 0.5, 0.9, 1.0), "square": (), "straight": (0.0, 0.4, 1.0)}  # shares of a leg's length
_TOP_FACES = 600  # of a light top, which leaves the others to the legs: stands have feet that are wide and thin …
_STAND_SIDES = {
    1: 40,
    2: 28,
    4: 20,
}  # … that simplification would make corners of, so light ones have few rings of few sides
_COVER = 0.9  # how much of the top's thickness legs may reach into
_STAND_SCALE = 0.65  # where Infinigen puts stands on average


@functools.cache
def prepare() -> tuple[Any, dict[str, Any]]:
    """Import Infinigen and make the graphs that every build of this process sets up anew: a top, legs by style."""
    module = import_infinigen(_MODULE)
    with silence():
        legs = {style: module.geometry_create_legs(**_example(module, style)) for style in _BENDS}
        top = module.nodegroup_generate_table_top()
    return graph_object(top), {style: graph_object(graph) for style, graph in legs.items()}


def build(params: Params) -> Mesh:
    return _build(params, light=False)


def build_light(params: Params) -> Mesh:
    """Fewer rings along legs, stretchers and the edge of the top, fewer sides around stands and stretchers."""
    return _build(params, light=True)


def _example(module: Any, style: str) -> dict[str, Any]:
    """Any parameters of the factory for a style; every build sets those that matter."""
    with module.FixedSeed(0):
        example = module.TableDiningFactory.sample_parameters((1.0, 1.0, 1.0))
    curve = [(bend, 1.0) for bend in _BENDS[style]]
    style = style.replace("-", "_")
    return example | {"Leg Style": style, "Leg Curve Control Points": curve, "TopMaterial": None, "LegMaterial": None}


def _build(p: Any, light: bool) -> Mesh:
    with silence():
        top, *legs = _pieces(p, light)
    room = p["dimension_z"] - p["top_thickness"]
    through = max(0.0, legs[0][1][:, 2].max() - room - _COVER * p["top_thickness"])
    legs = [_lifted(leg, (p["leg_height"] - 1) * room) for leg in legs]
    return join([_lifted(top, p["leg_height"] * room + through), *legs])


def _lifted(piece: Piece, by: float) -> Piece:
    part, vertices, faces = piece
    return part, vertices + np.array([0, 0, by], np.float32), faces


def _pieces(p: Any, light: bool) -> Iterator[Piece]:
    top, legs = prepare()[0], prepare()[1][p["leg_style"]]
    set_inputs(top, _top(p))
    set_node(find_node(graph_of(top), "FILLET_CURVE"), {"Count": 1 if light else 8})
    piece = recapped(read_piece("top", evaluated(top)))
    yield _thinned(piece) if light else piece
    _set_legs(graph_of(legs), p, light)
    for part in ("leg", "stretcher") if _has_stretchers(p) else ("leg",):
        set_node(find_node(graph_of(legs), "nodegroup_create_legs_and_strechers"), _kept(part))
        yield read_piece(part, evaluated(legs))


def _thinned(piece: Piece) -> Piece:
    thin = simplify(join([piece]), _TOP_FACES, error=0.0001)
    return piece[0], thin.vertices, thin.faces


def _has_stretchers(p: Any) -> bool:
    return p["leg_style"] == "straight" and p["strecher_increament"] > 0


def _kept(part: str) -> dict[str, bool]:
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
    """Where legs stand, and how one of them looks."""
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
    """Set the heights of the curve that says how wide a leg is along its length."""
    radius = find_node(leg.node_tree, "nodegroup_generate_radius_curve")
    curve = find_node(radius.node_tree, "CURVE_FLOAT").mapping
    for point, width in zip(curve.curves[0].points, widths, strict=True):
        point.location = (point.location[0], width)
    curve.update()
    radius.node_tree.update_tag()
