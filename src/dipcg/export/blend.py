"""Assets through Blender: its own files, with Infinigen's materials or live Geometry Nodes, and FBX."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from dipcg.blender.declaration import live_settings
from dipcg.materials import Finish
from dipcg.mesh import Mesh
from dipcg.space import Params, params_to_json
from dipcg.workers.rpc import Blender


def write_blend(mesh: Mesh, generator: str, params: Params, seed: int, path: Path) -> None:
    """Write the mesh with its materials, or for a generator from a Blender file that file with the parameters set.

    Raises workers.rpc.BlenderError with a sentence.
    """
    if generator.endswith(".toml"):
        program, place, settings = live_settings(Path(generator), params)
        with Blender(program) as blender:
            blender.call("geometry_nodes:save_with", place, settings, str(path.absolute()))
    else:
        with Blender() as blender:
            arguments = mesh, generator, Path(generator).stem, seed, params_to_json(params, generator)
            blender.call("outliner:write_blend", *arguments, str(path.absolute()))


def write_fbx(mesh: Mesh, name: str, finishes: tuple[Finish, ...], path: Path) -> None:
    """Write the mesh as FBX, with plain materials; raises workers.rpc.BlenderError with a sentence."""
    with Blender() as blender:
        blender.call("outliner:write_fbx", mesh, name, [asdict(finish) for finish in finishes], str(path.absolute()))
