"""Pictures for people: a photograph beside its estimate, and contact sheets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.images import MARGIN, over_white, prepare, save_image
from dipcg.mesh import Mesh
from dipcg.pipeline import Estimate
from dipcg.render import Renderer, studio

Tile = UInt8[np.ndarray, "s s 3"]
SIDE = 384
# The camera for an estimate from text, which has none of its own.
TEXT_VIEW = View(-30.0, 20.0, 2.5)


def side_by_side(estimate: Estimate, asset: Asset, path: str | Path | None = None) -> UInt8[np.ndarray, "h w 3"]:
    """The picture as the model saw it, the result from the estimated camera, and the result turned by 60°.

    An estimate from text has no picture and no camera: its result is seen from two sides.
    """
    from_text = estimate.background == "words"
    view = TEXT_VIEW if from_text else estimate.view
    turned = View(view.azimuth_deg + 60, 20.0, view.distance)
    photo = [] if from_text else [prepare(np.ascontiguousarray(estimate.image), SIDE)[0]]
    drawn = [studio.draw(asset.mesh, asset.materials, view, SIDE, MARGIN) for view in (view, turned)]
    sheet = np.concatenate([over_white(image) for image in (*photo, *drawn)], 1)
    if path:
        save_image(sheet, path)
    return sheet


def contact_sheet(meshes: Sequence[Mesh], path: str | Path, columns: int = 8, side: int = 192) -> None:
    """Write all meshes from the same camera in rows."""
    renderer = Renderer(side)
    tiles = [over_white(renderer.render(mesh, View(30.0, 20.0), margin=MARGIN)) for mesh in meshes]
    renderer.close()
    save_image(in_rows(tiles, columns), path)


def same_camera(assets: Sequence[Asset], view: View, side: int = SIDE) -> list[Tile]:
    """A picture of each asset, all on one floor and from one camera that sees them all."""
    floors = [np.array([0, 0, one.mesh.bounds[0, 2]], np.float32) for one in assets]
    standing = [replace(one.mesh, vertices=one.mesh.vertices - low) for one, low in zip(assets, floors, strict=True)]
    every = np.concatenate([mesh.vertices for mesh in standing])
    # Vertices of no face are not drawn, but frame the picture and place the camera.
    framed = [replace(mesh, vertices=np.concatenate([mesh.vertices, every])) for mesh in standing]
    pairs = zip(framed, assets, strict=True)
    return [over_white(studio.draw(mesh, asset.materials, view, side, MARGIN)) for mesh, asset in pairs]


def in_rows(tiles: Sequence[Tile], columns: int) -> UInt8[np.ndarray, "h w 3"]:
    """Square tiles in rows; white tiles fill the last row."""
    blank = np.full_like(tiles[0], 255)
    full = [*tiles, *[blank] * (-len(tiles) % columns)]
    rows = [np.concatenate(full[i : i + columns], 1) for i in range(0, len(full), columns)]
    return np.concatenate(rows)
