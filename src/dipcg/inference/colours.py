"""The colours of a photograph for the parts of its estimate."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.images import MARGIN, crop_to_object, prepare
from dipcg.inference.compare import is_line_drawing
from dipcg.materials import NEUTRAL, Colour, as_colour, family, part_colours
from dipcg.mesh import Mesh
from dipcg.render import Look, Renderer
from dipcg.results import Estimate

Colours = Literal["photo", "material", "parts"]
SIDE = 256
# A part is seen where this many pixels are its own and not at its edge.
LEAST_PIXELS = 12
# Half of the width in pixels from which a part is surely met.
THICK = 3.5


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
    return photo_colours(estimate.image, mesh, view, estimate.ref)


def photo_colours(image: UInt8[np.ndarray, "h w 4"], mesh: Mesh, view: View, generator: str = "") -> dict[str, Colour]:
    """For each part that is seen the median colour of what the photograph shows there.

    Pixels at the edge of a part or of the object are left out, and parts that are thinner than what an estimate is off
    by: they may lie beside themselves in the photograph, on the ground. A thin part counts as seen only where no part
    of its family is thicker. Where the estimate does not meet the object in the photograph, no part is seen.
    """
    picture = prepare(np.ascontiguousarray(image), SIDE)[0]
    seen = _seen(mesh, view)
    kernel = np.ones((3, 3), np.uint8)
    inside = np.asarray(cv2.erode((picture[..., 3] > 250).astype(np.uint8), kernel), np.uint8) > 0
    own = {name: inside & (seen == part) for part, name in enumerate(mesh.part_names)}
    clear = _clear({name: here for name, here in own.items() if here.sum() >= LEAST_PIXELS}, generator)
    return {name: as_colour(np.median(picture[own[name]][:, :3], axis=0) / 255) for name in clear}


def _clear(own: dict[str, Bool[np.ndarray, "h w"]], generator: str) -> list[str]:
    """The parts that are thick, and those that are the thickest of their family or have none."""
    half = {name: _half_width(here) for name, here in own.items()}
    kinds = {name: kind if (kind := family(generator, name)) != NEUTRAL else name for name in own}
    thickest = {kind: max(half[name] for name in own if kinds[name] == kind) for kind in kinds.values()}
    return [name for name in own if half[name] >= min(THICK, thickest[kinds[name]])]


def _half_width(where: Bool[np.ndarray, "h w"]) -> float:
    """The largest distance of a pixel to the edge of the region."""
    return float(cv2.distanceTransform(where.astype(np.uint8), cv2.DIST_L2, 5).max())


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
