"""The colours of a photograph for the parts of its estimate."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Int, UInt8

from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.images import MARGIN, prepare
from dipcg.inference.samples import Sample, samples
from dipcg.materials import NEUTRAL, Colour, as_colour, family, part_colours
from dipcg.mesh import Mesh
from dipcg.render import Look, Renderer
from dipcg.results import Estimate

Colours = Literal["photo", "material", "parts"]
SIDE = 256
# Half of the width in pixels from which a part is surely met; less where pixels of the ground can be told.
THICK, THICK_ON_GROUND = 3.5, 2.5
# Where pixels of the ground can be told, a thin part is surely met too when this share of its pixels is found.
FOUND = 0.4


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
    if estimate.background in ("words", "drawing"):
        return {}
    return photo_colours(estimate.image, mesh, view, estimate.ref, estimate.ground)


def photo_colours(
    image: UInt8[np.ndarray, "h w 4"],
    mesh: Mesh,
    view: View,
    generator: str = "",
    ground: Colour | None = None,
) -> dict[str, Colour]:
    """For each part that is seen the median colour of the pixels that show it, as `samples` finds them.

    A thin part, which an estimate that is a little off shows beside itself, counts as seen where no part of its family
    is thicker, or where the `ground` is known and enough of the part's pixels are not ground. One that may show the
    ground counts only where none of its family surely shows itself. Where the estimate does not meet the object in the
    photograph, no part is seen.
    """
    picture = prepare(np.ascontiguousarray(image), SIDE)[0]
    found = samples(picture, _drawn(mesh, view), len(mesh.part_names), ground)
    sure = _sure({mesh.part_names[part]: sample for part, sample in found.items()}, generator, ground)
    return {name: as_colour(np.median(picture[one.where][:, :3], axis=0) / 255) for name, one in sure.items()}


def _sure(found: dict[str, Sample], generator: str, ground: Colour | None) -> dict[str, Sample]:
    """The parts that are thick, the thickest of their family, or found; those in doubt only where all of it are."""
    kinds = {name: kind if (kind := family(generator, name)) != NEUTRAL else name for name in found}
    clear = {kinds[name] for name, one in found.items() if not one.doubtful}
    left = {name: one for name, one in found.items() if not (one.doubtful and kinds[name] in clear)}
    thickest = {kind: max(one.half for name, one in left.items() if kinds[name] == kind) for kind in kinds.values()}
    thick = THICK if ground is None else THICK_ON_GROUND
    met = {name for name, one in left.items() if ground is not None and one.share >= FOUND}
    return {name: one for name, one in left.items() if name in met or one.half >= min(thick, thickest[kinds[name]])}


def _drawn(mesh: Mesh, view: View) -> Int[np.ndarray, "s s"]:
    """For each pixel the part that is seen there, -1 where there is none."""
    levels = np.arange(1, len(mesh.part_names) + 1) / 255
    # The renderer draws the square of a colour and takes the root again; without lights the colour stays as it is.
    flat = Look(np.repeat(levels[:, None], 3, 1), np.ones((1, 3)), np.zeros(1), ambient=1.0)
    renderer = Renderer(SIDE)
    drawn = renderer.render(mesh, view, flat, MARGIN)
    renderer.close()
    return np.where(drawn[..., 3] == 255, drawn[..., 0].astype(int) - 1, -1)
