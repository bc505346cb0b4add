"""Assets through Blender: its own files, with Infinigen's materials or live Geometry Nodes, and FBX."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from dipcg.blender.declaration import live_settings
from dipcg.export.scene import on_floor
from dipcg.workers.rpc import Blender

if TYPE_CHECKING:
    from dipcg.export.asset import Asset


def write_blend(asset: Asset, path: Path) -> None:
    """Write the mesh with its materials, or for a generator from a Blender file that file with the parameters set.

    Raises workers.rpc.BlenderError with a sentence.
    """
    if asset.generator.endswith(".toml"):
        program, place, settings = live_settings(Path(asset.generator), asset.params)
        with Blender(program) as blender:
            blender.call("geometry_nodes:save_with", place, settings, str(path.absolute()))
    else:
        with Blender() as blender:
            arguments = on_floor(asset.mesh), asset.generator, asset.name, asset.material_seed, asset.document
            blender.call("outliner:write_blend", *arguments, str(path.absolute()))


def write_fbx(asset: Asset, path: Path) -> None:
    """Write the mesh as FBX, with plain materials; raises workers.rpc.BlenderError with a sentence."""
    finishes = [asdict(finish) for finish in asset.materials]
    with Blender() as blender:
        blender.call("outliner:write_fbx", on_floor(asset.mesh), asset.name, finishes, str(path.absolute()))
