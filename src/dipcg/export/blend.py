"""Assets through Blender: its own files, with Infinigen's materials or live Geometry Nodes, and FBX."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from dipcg.blender.declaration import live_settings
from dipcg.materials import Finish
from dipcg.mesh import Mesh
from dipcg.space import Params
from dipcg.workers.rpc import Blender


def write_live(generator: str, params: Params, path: Path) -> None:
    """Write the Blender file of a generator with its modifier's inputs set; raises workers.rpc.BlenderError."""
    program, place, settings = live_settings(Path(generator), params)
    with Blender(program) as blender:
        blender.call("geometry_nodes:save_with", place, settings, str(path.absolute()))


def write_blend(mesh: Mesh, generator: str, document: str, seed: int, path: Path) -> None:
    """Write a mesh on the floor with its materials and its parameter file; raises workers.rpc.BlenderError."""
    with Blender() as blender:
        blender.call(
            "outliner:write_blend", mesh, generator, Path(generator).stem, seed, document, str(path.absolute())
        )


def write_fbx(mesh: Mesh, name: str, materials: tuple[Finish, ...], path: Path) -> None:
    """Write a mesh on the floor as FBX, with plain materials; raises workers.rpc.BlenderError."""
    with Blender() as blender:
        blender.call("outliner:write_fbx", mesh, name, [asdict(finish) for finish in materials], str(path.absolute()))
