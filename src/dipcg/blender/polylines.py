"""Fewer points on lines for light builds; Infinigen puts one every few millimetres."""

from __future__ import annotations

from typing import Any

import numpy as np

# One minus the cosine of the least turn that stays, 11°.
CORNER = 0.02


def every_other_point(obj: Any, full_y: float | None = None, near: float = 0.025) -> Any:
    """Remove every other point of a line; corners, ends and points within `near` metres of `full_y` stay."""
    mesh = obj.data
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    steps = np.diff(points, axis=0)
    unit = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    turns = np.r_[1, 1 - (unit[1:] * unit[:-1]).sum(1), 1]
    stays = turns > CORNER
    stays[::2] = True
    if full_y is not None:
        stays |= np.abs(points[:, 1] - full_y) < near
    mesh.clear_geometry()
    mesh.from_pydata(points[stays], [(i, i + 1) for i in range(stays.sum() - 1)], [])
    return obj


def dissolve_straight(obj: Any, turn_deg: float = 2.0) -> None:
    """Dissolve the points where lines turn by less than `turn_deg`."""
    import bmesh

    lines = bmesh.new()
    lines.from_mesh(obj.data)
    bmesh.ops.dissolve_limit(lines, angle_limit=np.radians(turn_deg), verts=lines.verts, edges=lines.edges)
    lines.to_mesh(obj.data)
    lines.free()
