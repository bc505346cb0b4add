"""Assets as Blender files: Infinigen's materials, or a Geometry Nodes modifier whose inputs stay live."""

from __future__ import annotations

from pathlib import Path

from dipcg.blender.declaration import live_settings
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
            text = params_to_json(params, generator)
            blender.call("scene:write_blend", mesh, generator, seed, text, str(path.absolute()))
