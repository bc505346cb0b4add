"""Infinigen's chair with the paper's 48 parameters.

A thin adapter: it sets attributes of `ChairFactory` and calls the factory's own methods, part by part.

What the parameters do:
- Where the factory draws a number during a build (the smoothness of the back, the widest place of the seat), the
  adapter uses the middle of its range.
- The published pair `leg_offset_bar` is one range for both kinds of bars in the factory. Here `leg_offset_bar0` is the
  height of the y bars and `leg_offset_bar1` of the x bars.
- `arm_height` has no effect with `is_leg_round`, because the arms are tubes then.
- Faces and parts of two builds are equal. Some dozen bevelled vertices differ by up to 3e-8 m, because Blender's bevel
  adds numbers in an order that depends on memory addresses.

Sources: Infinigen Indoors (Raistrick et al. 2024) for the factory, DI-PCG's published parameters for list and ranges.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator
from typing import Any

import numpy as np

from dipcg.blender.infinigen import (
    clean_blender,
    coarse_modifiers,
    import_infinigen,
    middle,
    read_piece,
    replaced,
    silence,
)
from dipcg.blender.polylines import dissolve_straight, every_other_point
from dipcg.camera import ViewRange
from dipcg.mesh import Mesh, Solid, join
from dipcg.space import Choice, ParameterSpace, Params, Real

_SLANTED = {"leg_type": ("straight", "up-curved", "down-curved")}
_CURVED = {"leg_type": ("up-curved", "down-curved")}
_ARM = {"has_arm": (True,)}
_FLAT_ARM = {"has_arm": (True,), "is_leg_round": (False,)}
_X_BAR, _Y_BAR = {"has_leg_x_bar": (True,)}, {"has_leg_y_bar": (True,)}
_PARTIAL = {"back_type": ("partial",)}
_SLATS = {"back_type": ("horizontal-bar",)}
_THREE_SLATS = _SLATS | {"back_profile_horizontal_ncuts": (3, 4)}
_FOUR_SLATS = _SLATS | {"back_profile_horizontal_ncuts": (4,)}
_SPINDLES = {"back_type": ("vertical-bar",)}
_OFF_ON = (False, True)

space = ParameterSpace(
    Real("width", 0.3, 0.8, unit="m", doc="of the seat, along x", group="seat"),
    Real("size", 0.35, 0.5, unit="m", doc="depth of the seat, along y", group="seat"),
    Real("thickness", 0.02, 0.1, unit="m", doc="of the seat", group="seat"),
    Choice("bevel_width", (0.1, 0.5), unit="of thickness", doc="how round edges are", group="seat"),
    Real("seat_back", 0.6, 1.0, unit="of width", doc="width of the seat at the back", group="seat"),
    Real("seat_mid", 0.7, 0.8, unit="of depth", doc="where the side of the seat bends", group="seat"),
    Real("seat_mid_z", 0.0, 0.7, unit="of thickness", doc="rise of the side of the seat", group="seat"),
    Real("seat_front", 1.0, 1.2, unit="of depth", doc="how far the front bulges", group="seat"),
    Choice("is_seat_round", _OFF_ON, doc="rounded front corners", group="seat"),
    Choice("is_seat_subsurf", _OFF_ON, doc="softened outline of the seat", group="seat"),
    Real("leg_thickness", 0.02, 0.07, unit="m", doc="of legs and bars", group="leg"),
    Real("limb_profile", 1.5, 2.5, unit="×", doc="how strongly legs curve", group="leg", when=_CURVED),
    Real("leg_height", 0.2, 1.0, unit="m", doc="from floor to seat", group="leg"),
    Choice(
        "is_leg_round",
        _OFF_ON,
        doc="True: square legs and tubes for arms; False: tubes for legs and flat arms (Infinigen's name)",
        group="leg",
    ),
    Choice("leg_type", ("vertical", "straight", "up-curved", "down-curved"), doc="shape of the legs", group="leg"),
    Choice("has_leg_x_bar", _OFF_ON, doc="bars between left and right legs", group="bar"),
    Choice("has_leg_y_bar", _OFF_ON, doc="bars between front and back legs", group="bar"),
    Real("leg_offset_bar0", 0.1, 0.9, unit="of leg height", doc="y bars below the seat", group="bar", when=_Y_BAR),
    Real("leg_offset_bar1", 0.1, 0.9, unit="of leg height", doc="x bars below the seat", group="bar", when=_X_BAR),
    Real("leg_x_offset", 0.0, 0.2, unit="of width", doc="feet outwards", group="leg", when=_SLANTED),
    Real("leg_y_offset0", 0.0, 0.2, unit="of depth", doc="back feet backwards", group="leg", when=_SLANTED),
    Real("leg_y_offset1", 0.0, 0.2, unit="of depth", doc="front feet forwards", group="leg", when=_SLANTED),
    Choice("has_arm", _OFF_ON, doc="has arms", group="arm"),
    Real("arm_thickness", 0.02, 0.07, unit="m", doc="of the arms", group="arm", when=_ARM),
    Real("arm_height", 0.6, 1.0, unit="of arm thickness", doc="of flat arms", group="arm", when=_FLAT_ARM),
    Real("arm_y", 0.5, 1.0, unit="of depth", doc="where arms meet the seat", group="arm", when=_ARM),
    Real("arm_z", 0.25, 0.6, unit="of back height", doc="where arms meet the back", group="arm", when=_ARM),
    Real("arm_mid0", -0.03, 0.03, unit="m", doc="bend of the arms, along x", group="arm", when=_ARM),
    Real("arm_mid1", -0.03, 0.2, unit="m", doc="bend of the arms, along y", group="arm", when=_ARM),
    Real("arm_mid2", -0.09, 0.03, unit="m", doc="bend of the arms, along z", group="arm", when=_ARM),
    Real("arm_profile0", 0.0, 2.0, unit="×", doc="reach of the curve before the bend", group="arm", when=_ARM),
    Real("arm_profile1", 0.0, 2.0, unit="×", doc="reach of the curve after the bend", group="arm", when=_ARM),
    Real("back_height", 0.3, 0.6, unit="m", doc="above the seat", group="back"),
    Real("back_thickness", 0.02, 0.07, unit="m", doc="of posts and panel", group="back"),
    Choice(
        "back_type", ("whole", "partial", "horizontal-bar", "vertical-bar"), doc="what fills the back", group="back"
    ),
    Choice("back_vertical_cuts", (1, 2, 3, 4), doc="number of upright bars", group="back", when=_SPINDLES),
    Real(
        "back_partial_scale",
        1.0,
        1.4,
        unit="×",
        doc="how far a partial panel is shifted back",
        group="back",
        when=_PARTIAL,
    ),
    Real("back_x_offset", -0.1, 0.15, unit="of width", doc="top of the posts inwards", group="back", when=_SLANTED),
    Real("back_y_offset", 0.0, 0.4, unit="of depth", doc="top of the posts backwards", group="back", when=_SLANTED),
    Real(
        "back_profile_partial",
        0.4,
        0.8,
        unit="of back height",
        doc="lower edge of a partial panel",
        group="back",
        when=_PARTIAL,
    ),
    Choice("back_profile_horizontal_ncuts", (2, 3, 4), doc="number of slats", group="back", when=_SLATS),
    *(
        Real(
            f"back_profile_horizontal_locs{i}",
            1.0,
            2.0,
            unit="share",
            doc=f"height of slat {i + 1} with its gap",
            group="back",
            when=when,
        )
        for i, when in enumerate((_SLATS, _SLATS, _THREE_SLATS, _FOUR_SLATS))
    ),
    Real(
        "back_profile_horizontal_ratio", 0.2, 0.8, unit="of slat", doc="gap below each slat", group="back", when=_SLATS
    ),
    Real(
        "back_profile_horizontal_lowest",
        0.0,
        0.4,
        unit="of back height",
        doc="where slats start",
        group="back",
        when=_SLATS,
    ),
    Real(
        "back_profile_vertical",
        0.8,
        0.9,
        unit="of back height",
        doc="lower edge of the top rail",
        group="back",
        when=_SPINDLES,
    ),
)
# What people read for the names of Infinigen.
labels = {
    "size": "depth", "bevel_width": "roundness of edges", "seat_back": "width at the back",
    "seat_mid": "bend of the side", "seat_mid_z": "rise of the side", "seat_front": "bulge of the front",
    "is_seat_round": "rounded front corners", "is_seat_subsurf": "softened outline",
    "limb_profile": "strength of the curve", "is_leg_round": "square legs, round arms", "leg_type": "shape",
    "has_leg_x_bar": "bars from left to right", "has_leg_y_bar": "bars from front to back",
    "leg_offset_bar0": "place of front to back bars", "leg_offset_bar1": "place of left to right bars",
    "leg_x_offset": "feet outwards", "leg_y_offset0": "back feet backwards", "leg_y_offset1": "front feet forwards",
    "has_arm": "arms", "arm_y": "place on the seat", "arm_z": "place on the back", "arm_mid0": "bend sideways",
    "arm_mid1": "bend forwards", "arm_mid2": "bend upwards", "arm_profile0": "curve before the bend",
    "arm_profile1": "curve after the bend", "back_type": "filling", "back_vertical_cuts": "upright bars",
    "back_partial_scale": "panel backwards", "back_x_offset": "top inwards", "back_y_offset": "top backwards",
    "back_profile_partial": "lower edge of the panel", "back_profile_horizontal_ncuts": "slats",
    "back_profile_horizontal_locs0": "height of slat 1", "back_profile_horizontal_locs1": "height of slat 2",
    "back_profile_horizontal_locs2": "height of slat 3", "back_profile_horizontal_locs3": "height of slat 4",
    "back_profile_horizontal_ratio": "gap below a slat", "back_profile_horizontal_lowest": "start of the slats",
    "back_profile_vertical": "lower edge of the rail",
}  # fmt: skip
views = ViewRange(azimuth_deg=(-180, 180), elevation_deg=(-5, 50))
needs = ("infinigen", "bpy")
# Blender becomes slower with each build of a chair.
recycle_after = 250

_MODULE = "infinigen.assets.objects.seating.chairs.chair"


@functools.cache
def prepare() -> Any:
    """Import Infinigen and make the factory that all builds of this process use."""
    module = import_infinigen(_MODULE)
    with silence():
        return module.ChairFactory(0)


def build(params: Params) -> Mesh:
    """The full mesh of the chair."""
    return _build(params, contextlib.nullcontext())


def build_light(params: Params) -> Mesh:
    """A coarser mesh: tubes of 12 sides instead of 32, bevels of 2 steps instead of 8, half the points of the seat.

    Straight limbs have no points between their ends, and a subdivision that leaves the shape as it is is omitted. One
    armchair in twenty differs from the full one by 2 to 3 % of its side at the ends of its arms. They end at the
    outermost point of the seat, and its upper and lower edge are equally far out up to a fraction of a millimetre.
    """
    factory, module = prepare(), import_infinigen(_MODULE)
    tube, subdivide, line, solidify = module.geo_radius, module.subsurf, module.bezier_curve, type(factory).solidify
    # The point of the outline at which the arms end must remain.
    arm = -float(params["arm_y"]) * float(params["size"]) if params["has_arm"] else None

    def thin(obj: Any, axis: int, thickness: float | None = None) -> Any:
        dissolve_straight(obj)
        return solidify(factory, obj, axis, thickness)

    coarse = {
        "geo_radius": lambda nodes, radius, sides=6, **rest: tube(nodes, radius, min(sides, 12), **rest),
        "subsurf": lambda obj, levels, simple=False: subdivide(obj, 0 if simple else levels, simple),
        "bezier_curve": lambda *args, **settings: every_other_point(line(*args, **settings), arm),
    }
    with replaced(module.butil, modify_mesh=coarse_modifiers(module.butil)), replaced(factory, solidify=thin):
        return _build(params, replaced(module, **coarse))


def _build(params: Params, detail: contextlib.AbstractContextManager[None]) -> Mesh:
    factory, module = prepare(), import_infinigen(_MODULE)
    clean_blender()
    for name, value in _attributes(params).items():
        setattr(factory, name, value)
    # The factory marks faces for its materials with one node graph each, but the parts already carry their names.
    marks = replaced(module, uniform=middle, write_attribute=lambda *args, **settings: None)
    with silence(), marks, detail:
        return join(list(_pieces(factory, params)))


def _pieces(factory: Any, p: Params) -> Iterator[Solid]:
    """The parts, in an order in which bars and panels get the centre lines of limbs that have no thickness yet."""
    seat, legs, backs = factory.make_seat(), factory.make_legs(), factory.make_backs()
    bars = [*_bars(factory, legs, "x", p), *_bars(factory, legs, "y", p)]
    arms = factory.make_arms(seat, backs) if p["has_arm"] else []
    panels = factory.make_back_decors(backs)
    legs = [factory.solidify(leg, 2) for leg in legs]
    posts = [factory.solidify(post, 2, factory.back_thickness) for post in backs]
    for part, objects in (("seat", [seat]), ("leg", legs), ("back", posts + panels), ("arm", arms), ("bar", bars)):
        yield from (read_piece(part, obj) for obj in objects)


def _bars(factory: Any, legs: list[Any], axis: str, p: Any) -> list[Any]:
    """The bars along one axis alone, because the factory draws the heights of both from one range."""
    for other in ("x", "y"):
        setattr(factory, f"has_leg_{other}_bar", other == axis and p[f"has_leg_{axis}_bar"])
    height = p["leg_offset_bar1" if axis == "x" else "leg_offset_bar0"]
    factory.leg_offset_bar = (height, height)
    return factory.make_leg_decors(legs)


def _attributes(p: Any) -> dict[str, Any]:
    """The attributes of the factory, in its own units, from the parameters."""
    same = [name for name in space.names if name not in _TRANSLATED and not name.startswith("back_profile")]
    slanted = p["leg_type"] != "vertical"
    widest = p["seat_back"] + p["seat_mid"] * (1 - p["seat_back"])
    return {name: p[name] for name in same} | {
        "bevel_width": p["thickness"] * p["bevel_width"],
        "seat_mid_x": (widest + 1) / 2,
        "arm_height": p["arm_height"] * p["arm_thickness"],
        "arm_y": p["arm_y"] * p["size"],
        "arm_z": p["arm_z"] * p["back_height"],
        "arm_mid": np.array([p["arm_mid0"], p["arm_mid1"], p["arm_mid2"]]),
        "arm_profile": (p["arm_profile0"], p["arm_profile1"]),
        "leg_x_offset": slanted * p["leg_x_offset"] * p["width"],
        "leg_y_offset": (slanted * p["leg_y_offset0"] * p["size"], slanted * p["leg_y_offset1"] * p["size"]),
        "back_x_offset": slanted * p["back_x_offset"] * p["width"],
        "back_y_offset": slanted * p["back_y_offset"] * p["size"],
        "back_profile": _back_profile(p),
    }


# Parameters with other units than the factory's attribute of the same name, or without such an attribute.
_TRANSLATED = {
    *("bevel_width", "arm_height", "arm_y", "arm_z", "arm_mid0", "arm_mid1", "arm_mid2", "arm_profile0"),
    *("arm_profile1", "leg_x_offset", "leg_y_offset0", "leg_y_offset1", "back_x_offset", "back_y_offset"),
    *("leg_offset_bar0", "leg_offset_bar1"),
}


def _back_profile(p: Any) -> list[tuple[float, float]]:
    """The spans of the back that are filled, as shares of its height."""
    match p["back_type"]:
        case "partial":
            return [(p["back_profile_partial"], 1.0)]
        case "vertical-bar":
            return [(p["back_profile_vertical"], 1.0)]
        case "horizontal-bar":
            return _slats(p)
        case _:
            return [(0.0, 1.0)]


def _slats(p: Any) -> list[tuple[float, float]]:
    count, lowest = p["back_profile_horizontal_ncuts"], p["back_profile_horizontal_lowest"]
    tops = np.cumsum([p[f"back_profile_horizontal_locs{i}"] for i in range(count)])
    tops = tops / tops[-1]
    bottoms = np.concatenate([[0], tops[:-1]])
    bottoms = bottoms + p["back_profile_horizontal_ratio"] * (tops - bottoms)
    return [
        (lowest + (1 - lowest) * low, lowest + (1 - lowest) * high) for low, high in zip(bottoms, tops, strict=True)
    ]
