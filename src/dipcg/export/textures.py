"""Infinigen's procedural materials baked to maps, so that other programs show them."""

from __future__ import annotations

from dataclasses import replace

from dipcg.export.asset import Asset
from dipcg.mesh.simplify import drop_degenerate
from dipcg.mesh.surface import Maps
from dipcg.workers.process import Progress
from dipcg.workers.rpc import Blender, BlenderError


def texture(asset: Asset, size: int = 512, seed: int = 0, progress: Progress | None = None) -> Asset:
    """The asset with base colour, roughness, metallic and normal maps of `size` × `size` pixels.

    `seed` draws the materials; `progress` is called with the share of the work that is done and the next step. Raises
    ModuleNotFoundError without Blender, and workers.rpc.BlenderError.
    """
    mesh = drop_degenerate(asset.mesh)
    with Blender() as blender:
        maps = blender.call("bake:bake", mesh, asset.generator, seed, size, progress=progress)
    if not isinstance(maps, Maps) or len(maps.uv) != len(mesh.faces):
        raise BlenderError("The maps that came back are not those of this mesh.")
    return replace(asset, mesh=mesh, maps=maps, material_seed=seed)
