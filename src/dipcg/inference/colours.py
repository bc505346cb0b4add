"""The colours of a photograph for the parts of its estimate."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from jaxtyping import UInt8

from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.images import MARGIN, crop_to_object, prepare
from dipcg.inference.compare import is_line_drawing
from dipcg.materials import Colour, as_colour, linear, part_colours, srgb
from dipcg.mesh import Mesh
from dipcg.render import Look, Renderer
from dipcg.results import Estimate

Colours = Literal["photo", "material", "parts"]
SIDE = 256
# A part is seen where this many pixels are its own and not at its edge.
LEAST_PIXELS = 12


def with_colours(asset: Asset, estimate: Estimate | None = None, colours: Colours = "photo") -> Asset:
    """The asset in the colours of the photograph, of plausible materials, or with one colour for each part.

    Without an estimate, `photo` leaves the asset with the colours that it has.
    """
    if colours == "parts":
        return replace(asset, colours=part_colours(asset.mesh.part_names))
    if colours == "material":
        return replace(asset, colours={})
    return asset if estimate is None else replace(asset, colours=seen_colours(estimate, asset.mesh, estimate.view))


def seen_colours(estimate: Estimate, mesh: Mesh, view: View) -> dict[str, Colour]:
    """The colours of the picture on the parts that it shows; none for a sentence, or for a line drawing."""
    if estimate.background == "words" or is_line_drawing(crop_to_object(estimate.image, SIDE)):
        return {}
    return photo_colours(estimate.image, mesh, view)


def photo_colours(image: UInt8[np.ndarray, "h w 4"], mesh: Mesh, view: View) -> dict[str, Colour]:
    """For each part that is seen the mean colour, in linear light, of what the photograph shows there.

    Pixels at the edge of a part or of the object are left out. Where the estimate does not meet the object in the
    photograph, no part is seen.
    """
    picture = prepare(np.ascontiguousarray(image), SIDE)[0]
    seen = _seen(mesh, view)
    kernel = np.ones((3, 3), np.uint8)
    inside = np.asarray(cv2.erode((picture[..., 3] > 250).astype(np.uint8), kernel), np.uint8) > 0
    light, every = linear(picture[..., :3] / 255.0), inside & (seen >= 0)
    own = {name: every & (seen == part) for part, name in enumerate(mesh.part_names)}
    return {name: as_colour(srgb(light[here].mean(0))) for name, here in own.items() if here.sum() >= LEAST_PIXELS}


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
