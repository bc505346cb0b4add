"""The colours of a photograph for the parts of its estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.images import MARGIN, prepare
from dipcg.materials import Colour, as_colour, coloured, finishes, linear, part_finishes, srgb
from dipcg.mesh import Mesh
from dipcg.render import Look, Renderer
from dipcg.results import Estimate

Colours = Literal["photo", "material", "parts"]
SIDE = 256
# A part is seen where this many pixels are its own and not at its edge.
LEAST_PIXELS = 12


def with_colours(asset: Asset, colours: Colours, estimate: Estimate | None = None) -> Asset:
    """The asset in the colours of the photograph, of plausible materials, or with one colour for each part.

    Without a photograph its parts have plausible materials.
    """
    names = asset.mesh.part_names
    if colours == "parts":
        return replace(asset, finishes=part_finishes(names))
    plain = finishes(asset.generator, names)
    if colours == "photo" and estimate is not None and estimate.background != "words":
        plain = coloured(plain, photo_colours(estimate.image, asset.mesh, estimate.view))
    return replace(asset, finishes=plain)


def photo_colours(image: UInt8[np.ndarray, "h w 4"], mesh: Mesh, view: View) -> Mapping[int, Colour]:
    """For each part the mean colour, in linear light, of what the photograph shows where the part is seen.

    Pixels at the edge of a part or of the object are left out. A part that is not seen has the colour of all that is.
    Nothing is returned when the estimate does not meet the object in the photograph.
    """
    picture = prepare(np.ascontiguousarray(image), SIDE)[0]
    seen = _seen(mesh, view)
    kernel = np.ones((3, 3), np.uint8)
    inside = np.asarray(cv2.erode((picture[..., 3] > 250).astype(np.uint8), kernel), np.uint8) > 0
    light, every = linear(picture[..., :3] / 255.0), inside & (seen >= 0)
    if every.sum() < LEAST_PIXELS:
        return {}
    parts = range(len(mesh.part_names))
    return {part: _mean(light, every & (seen == part), every) for part in parts}


def _mean(light: Float[np.ndarray, "h w 3"], own: Bool[np.ndarray, "h w"], every: Bool[np.ndarray, "h w"]) -> Colour:
    chosen = own if own.sum() >= LEAST_PIXELS else every
    return as_colour(srgb(light[chosen].mean(0)))


def _seen(mesh: Mesh, view: View) -> np.ndarray:
    """For each pixel the part that is seen there, -1 at edges and where there is none."""
    levels = np.arange(1, len(mesh.part_names) + 1) / 255
    # The renderer draws the square of a colour and takes the root again; without lights the colour stays as it is.
    flat = Look(np.repeat(levels[:, None], 3, 1), np.ones((1, 3)), np.zeros(1), ambient=1.0)
    renderer = Renderer(SIDE)
    drawn = renderer.render(mesh, view, flat, MARGIN)
    renderer.close()
    part = np.where(drawn[..., 3] == 255, drawn[..., 0].astype(int) - 1, -1)
    kernel = np.ones((3, 3), np.uint8)
    same = cv2.erode((part + 1).astype(np.uint8), kernel) == cv2.dilate((part + 1).astype(np.uint8), kernel)
    return np.where(same, part, -1)
