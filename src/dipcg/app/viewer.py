"""Meshes and pictures as the page's scripts take them: plain values that JSON can carry."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from dipcg.camera import View
from dipcg.mesh import Mesh, compact
from dipcg.render import PALETTE

OPEN_FROM = View(30.0, 20.0)  # where an asset without a picture is seen from


def scene(mesh: Mesh, view: View | None, opened: int) -> dict[str, Any]:
    """A mesh for page/viewer.js; it aims its camera at `view` whenever `opened` is another number."""
    mesh, view = compact(mesh), view or OPEN_FROM
    counts = 3 * np.bincount(mesh.parts, minlength=len(mesh.part_names))
    ends = np.cumsum(counts)
    return {
        "vertices": _base64(mesh.vertices.astype("<f4").tobytes()),
        "faces": _base64(mesh.faces.astype("<u4").tobytes()),
        "parts": [_part(i, int(ends[i] - counts[i]), int(counts[i])) for i in range(len(counts))],
        "centre": mesh.centre.tolist(),
        "side": mesh.side,
        "view": {"azimuth": view.azimuth_deg, "elevation": view.elevation_deg, "distance": view.distance},
        "opened": opened,
    }


def data_url(image: UInt8[np.ndarray, "h w c"]) -> str:
    """A picture as the address that holds it."""
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(file, "WEBP", quality=85)
    return "data:image/webp;base64," + _base64(file.getvalue())


def _part(number: int, first: int, count: int) -> dict[str, Any]:
    return {"first": first, "count": count, "colour": PALETTE[number % len(PALETTE)].tolist()}


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()
