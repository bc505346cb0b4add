"""A box with an optional lid and legs, made by NumPy alone: a small generator for tests and first trials."""

from __future__ import annotations

import numpy as np

from dipcg.camera import ViewRange
from dipcg.mesh import Mesh, join
from dipcg.space import Choice, ParameterSpace, Params, Real

space = ParameterSpace(
    Real("width", 0.3, 1.0, unit="m", doc="of the body, along x", group="body"),
    Real("depth", 0.3, 1.0, unit="m", doc="of the body, along y", group="body"),
    Real("height", 0.2, 1.0, unit="m", doc="of the body", group="body"),
    Choice("top", ("open", "flat", "pyramid"), doc="what covers the body", group="lid"),
    Real("lid_height", 0.1, 0.5, unit="m", doc="of the pyramid", group="lid", when={"top": ("pyramid",)}),
    Real(
        "overhang", 0.0, 0.15, unit="m", doc="of the lid over the body", group="lid", when={"top": ("flat", "pyramid")}
    ),
    Choice("has_legs", (False, True), doc="stands on four legs", group="legs"),
    Real("leg_height", 0.1, 0.5, unit="m", doc="of the legs", group="legs", when={"has_legs": (True,)}),
)
views = ViewRange(azimuth_deg=(-60.0, 60.0), elevation_deg=(5.0, 45.0))

# The width of a leg and the thickness of a wall, in metres.
LEG = 0.06
WALL = 0.03

_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
_QUADS = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
_TRIANGLES = np.concatenate([_QUADS[:, [0, 1, 2]], _QUADS[:, [0, 2, 3]]])


def build(params: Params) -> Mesh:
    """The mesh of the box, which stands on the floor and is centred on the origin along x and y."""
    width, depth, height = (float(params[name]) for name in ("width", "depth", "height"))
    base = float(params["leg_height"]) if params["has_legs"] else 0.0
    parts = [("body", *block) for block in _body(width, depth, height, base, open_top=params["top"] == "open")]
    if params["top"] != "open":
        parts.append(("lid", *_lid(params, width, depth, base + height)))
    if params["has_legs"]:
        parts += [("leg", *_block(x, y, 0, LEG, LEG, base)) for x in (0, width - LEG) for y in (0, depth - LEG)]
    mesh = join(parts)
    return Mesh(
        mesh.vertices - np.array([width / 2, depth / 2, 0], np.float32), mesh.faces, mesh.parts, mesh.part_names
    )


def _body(width: float, depth: float, height: float, base: float, open_top: bool) -> list[tuple]:
    if not open_top:
        return [_block(0, 0, base, width, depth, height)]
    return [
        _block(0, 0, base, width, depth, WALL),
        _block(0, 0, base, width, WALL, height),
        _block(0, depth - WALL, base, width, WALL, height),
        _block(0, 0, base, WALL, depth, height),
        _block(width - WALL, 0, base, WALL, depth, height),
    ]


def _lid(params: Params, width: float, depth: float, z: float) -> tuple:
    over = float(params["overhang"])
    vertices, faces = _block(-over, -over, z, width + 2 * over, depth + 2 * over, WALL)
    if params["top"] == "pyramid":
        vertices[4:] = [width / 2, depth / 2, z + float(params["lid_height"])]
        faces = faces[[np.unique(vertices[face], axis=0).shape[0] == 3 for face in faces]]
    return vertices, faces


def _block(x: float | int, y: float | int, z: float | int, dx: float, dy: float, dz: float) -> tuple:
    return _CORNERS * [dx, dy, dz] + [x, y, z], _TRIANGLES.copy()
