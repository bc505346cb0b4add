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
    with Blender() as blender:
        if generator.endswith(".toml"):
            blender.call("geometry_nodes:save_with", *live_settings(Path(generator), params), str(path))
        else:
            text = params_to_json(params, generator)
            blender.call("scene:write_blend", mesh, generator, seed, text, str(path.absolute()))
