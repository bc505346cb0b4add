"""The colours that a picture shows on the parts of an asset, as its estimated camera sees them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int64, UInt8

from dipcg.camera import View
from dipcg.images import MARGIN, crop_to_object
from dipcg.inference.compare import is_line_drawing
from dipcg.mesh import Mesh
from dipcg.render import Look, Renderer

# Pixels of a part, of a picture with a side of 256, below which its colour is not known.
FEWEST = 12
# Above this a pixel belongs to the object as a whole, and no ground shines through.
OPAQUE = 250
# Steps between the colours that stand for parts: mixtures at the edges of two parts then stand for none.
STEPS = np.array([1, 97, 57])


def part_colours(
    image: UInt8[np.ndarray, "h w 4"], mesh: Mesh, view: View, renderer: Renderer
) -> dict[str, tuple[float, float, float]]:
    """For each part that can be seen, the median colour of its pixels in the picture, in sRGB from 0 to 1.

    The picture is cut out. A line drawing has no colours.
    """
    photo = crop_to_object(image, renderer.size)
    if is_line_drawing(photo):
        return {}
    numbers, fewest = _seen_parts(mesh, view, renderer), FEWEST * (renderer.size / 256) ** 2
    numbers[photo[..., 3] < OPAQUE] = -1
    pixels = [photo[numbers == number, :3] for number in range(len(mesh.part_names))]
    medians = {n: np.median(p, axis=0) / 255 for n, p in zip(mesh.part_names, pixels, strict=True) if len(p) >= fewest}
    return {name: (float(red), float(green), float(blue)) for name, (red, green, blue) in medians.items()}


def _seen_parts(mesh: Mesh, view: View, renderer: Renderer) -> Int64[np.ndarray, "s s"]:
    """The number of the part at each pixel; -1 where there is none."""
    codes = (1 + np.arange(len(mesh.part_names))[:, None] * STEPS) % 256
    flat = Look(colours=codes / 255, strengths=np.zeros(2), ambient=1.0)
    drawn = renderer.render(mesh, view, flat, MARGIN).astype(np.int64)
    same = (drawn[..., None, :3] == codes).all(-1) & (drawn[..., 3:] == 255)
    return np.where(same.any(-1), same.argmax(-1), -1)
