"""Fewer points on the lines that Infinigen cuts every few millimetres, for light builds."""

from __future__ import annotations

from typing import Any

import numpy as np

CORNER = 0.02  # one minus the cosine of a turn that stays, 11°


def every_other_point(obj: Any, kept_y: float | None = None, near: float = 0.025) -> Any:
    """Drop every other point of a line, but for its corners and ends and what lies within `near` metres of `kept_y`."""
    mesh = obj.data
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    steps = np.diff(points, axis=0)
    unit = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    turns = np.r_[1, 1 - (unit[1:] * unit[:-1]).sum(1), 1]
    kept = turns > CORNER
    kept[::2] = True
    if kept_y is not None:
        kept |= np.abs(points[:, 1] - kept_y) < near
    mesh.clear_geometry()
    mesh.from_pydata(points[kept], [(i, i + 1) for i in range(kept.sum() - 1)], [])
    return obj


def dissolve_straight(obj: Any, turn_deg: float = 2.0) -> None:
    """Dissolve the points where lines turn by less than `turn_deg`."""
    import bmesh

    lines = bmesh.new()
    lines.from_mesh(obj.data)
    bmesh.ops.dissolve_limit(lines, angle_limit=np.radians(turn_deg), verts=lines.verts, edges=lines.edges)
    lines.to_mesh(obj.data)
    lines.free()
