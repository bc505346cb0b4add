"""A seashell: a tube that turns about an axis and grows as it goes, sculpted, open at the mouth, watertight.

Source: Raup 1966, Geometric analysis of shell coiling; expansion, distance and translation are his W, D and T.
"""

from __future__ import annotations

import numpy as np

from dipcg.mesh import Mesh, join
from dipcg.space import Choice, ParameterSpace, Params, Real

space = ParameterSpace(
    Real("turns", 4.0, 7.0, unit="turns", doc="of the tube about the axis", group="coil"),
    Real("expansion", 1.6, 3.5, unit="× a turn", doc="growth of the tube", group="coil"),
    Real("distance", 0.0, 0.45, unit="of the mouth's distance", doc="free space around the axis", group="coil"),
    Real("translation", 0.0, 2.5, unit="of the mouth's distance", doc="how far the spire rises", group="coil"),
    Choice("hand", ("right", "left"), doc="side of the mouth seen with the spire up", group="coil"),
    Real("mouth_height", 0.8, 2.0, unit="of the mouth's width", doc="of the opening", group="mouth"),
    Real("mouth_tilt", -30.0, 30.0, unit="°", doc="of the opening, outwards", group="mouth"),
    Real("lip", 0.0, 0.35, unit="of the mouth's width", doc="how far the edge of the mouth flares", group="mouth"),
    Choice("sculpture", ("smooth", "ribs", "cords", "spines"), doc="on the outside", group="sculpture"),
    Choice("ribs", (8, 12, 16, 24), doc="a turn", group="sculpture", when={"sculpture": ("ribs", "spines")}),
    Choice("cords", (5, 8, 12), doc="around the tube", group="sculpture", when={"sculpture": ("cords",)}),
    Real("relief", 0.04, 0.2, unit="of the mouth's width", doc="height of the sculpture", group="sculpture",
         when={"sculpture": ("ribs", "cords", "spines")}),
)  # fmt: skip
mirrors = {"hand": "-hand"}

# Metres from the axis to the outer edge of the mouth.
RADIUS = 0.05
# Vertices around the tube, and rings of a turn.
AROUND, A_TURN = 72, 90
# As a share of the mouth's width.
WALL = 0.05
# Turns of the tube that are visible through the mouth.
DEPTH = 0.6
# Turns over which the lip flares.
LIP = 0.12


def build(params: Params) -> Mesh:
    turns = float(params["turns"])
    outer = tube(params, np.linspace(-turns, 0, round(A_TURN * turns)), outside=True)
    inner = tube(params, np.linspace(0, -DEPTH, round(A_TURN * DEPTH)), outside=False)
    rings = np.concatenate([outer, inner])
    if params["hand"] == "left":
        rings = rings[:, ::-1] * [-1, 1, 1]
    vertices, faces = closed(rings)
    inside = faces.min(1) >= len(outer) * AROUND - AROUND
    mesh = join([("shell", vertices, faces)])
    return Mesh(mesh.vertices, mesh.faces, inside.astype(np.uint8), ("shell", "inside"))


def tube(params: Params, turn: np.ndarray, outside: bool) -> np.ndarray:
    """Rings of vertices, n AROUND 3; `turn` is 0 at the mouth and falls towards the tip."""
    hole, rise, tall = (float(params[key]) for key in ("distance", "translation", "mouth_height"))
    around = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)[None]
    turn = turn[:, None]
    # As a share of the mouth's width, whose distance from the axis is 1.
    half = (1 - hole) / 2
    swell = 1 + sculpture(params, turn, around) if outside else 1 - WALL
    swell = swell + float(params["lip"]) * np.clip(1 + turn / LIP, 0, 1) ** 2
    x, z = half * swell * np.cos(around), half * tall * swell * np.sin(around)
    tilt = np.radians(float(params["mouth_tilt"]))
    x, z = x * np.cos(tilt) - z * np.sin(tilt), x * np.sin(tilt) + z * np.cos(tilt)
    growth = RADIUS * float(params["expansion"]) ** turn
    # The mouth faces right and to the front.
    distance, angle = growth * (hole + half + x), 2 * np.pi * turn - np.pi / 2
    height = growth * (z - rise) + RADIUS * rise
    return np.stack([distance * np.cos(angle), distance * np.sin(angle), height + 0 * angle], -1)


def sculpture(params: Params, turn: np.ndarray, around: np.ndarray) -> np.ndarray:
    """How far the outside stands out, in shares of the tube's radius."""
    if params["sculpture"] == "smooth":
        return np.zeros((len(turn), AROUND))
    relief = 2 * float(params["relief"])
    if params["sculpture"] == "cords":
        return relief * 0.5 * (1 + np.cos(float(params["cords"]) * around)) + 0 * turn
    rib = (0.5 + 0.5 * np.cos(2 * np.pi * float(params["ribs"]) * turn)) ** 3
    if params["sculpture"] == "ribs":
        return relief * rib + 0 * around
    return 2 * relief * rib * np.clip(np.cos(around - 0.7), 0, 1) ** 8


def closed(rings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One closed surface through all rings, with a vertex in the middle of the first and of the last as its ends."""
    count, index = len(rings), np.arange(rings[..., 0].size).reshape(rings.shape[:2])
    here, along = index[:-1], index[1:]
    after, diagonal = np.roll(here, -1, 1), np.roll(along, -1, 1)
    sides = np.stack([here, along, diagonal, here, diagonal, after], -1).reshape(-1, 3)
    first, last = count * AROUND, count * AROUND + 1
    ends = [np.stack([np.full(AROUND, first), index[0], after[0]], -1)]
    ends += [np.stack([np.full(AROUND, last), np.roll(index[-1], -1), index[-1]], -1)]
    vertices = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(1)])
    return vertices, np.concatenate([sides, *ends])
