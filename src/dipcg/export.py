"""Assets as files that other programs open: GLB, OBJ, PLY and STL, one material per part."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dipcg.mesh import Mesh, drop_degenerate
from dipcg.render import PALETTE
from dipcg.space import Params, params_to_json

FORMATS = (".glb", ".gltf", ".obj", ".ply", ".stl")
Y_UP = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], float)  # glTF's axes from ours


class ExportError(ValueError):
    """A file that cannot be written, with a sentence that says why and what to do."""


@dataclass(frozen=True)
class Asset:
    """A mesh with the parameters that made it, and the name or path of their generator."""

    mesh: Mesh
    generator: str
    params: Params

    def export(self, path: str | Path) -> Path:
        """Write the mesh in the format that the suffix names, in metres; glTF is Y up, the others Z up.

        Raises ExportError with a sentence when the format is unknown or the file cannot be written.
        """
        path = check_target(path)
        suffix = path.suffix.lower()
        scene = to_trimesh(self.mesh, y_up=suffix in (".glb", ".gltf"))
        # No other file, or one named alike: trimesh's own names are the same for every asset of a folder.
        # PLY without attributes: trimesh looks for texture coordinates among them, and there are none.
        settings = {
            ".gltf": {"embed_buffers": True},
            ".obj": {"mtl_name": f"{path.stem}.mtl"},
            ".ply": {"include_attributes": False},
        }
        try:
            scene.export(path, **settings.get(suffix, {}))
        except OSError as error:
            raise ExportError(f"{path} cannot be written ({error.strerror or error}).") from None
        return path

    def save_params(self, path: str | Path) -> Path:
        """Write the parameters as JSON, for `dipcg edit`."""
        Path(path).write_text(params_to_json(self.params, self.generator))
        return Path(path)


def check_target(path: str | Path, formats: tuple[str, ...] = FORMATS) -> Path:
    """The path as one that can be written to; raises ExportError before any work is done."""
    path = Path(path)
    if path.suffix.lower() not in formats:
        raise ExportError(f"{path.name} has no known ending; use one of {', '.join(formats)}.")
    if not path.parent.is_dir():
        raise ExportError(f"The folder {path.parent} does not exist; make it first, or choose another.")
    try:
        existed = path.exists()
        path.open("ab").close()
        if not existed:
            path.unlink()
    except OSError as error:
        raise ExportError(f"{path} cannot be written ({error.strerror}).") from None
    return path


def to_trimesh(mesh: Mesh, y_up: bool = False) -> Any:
    """A trimesh scene with one named, coloured geometry per part."""
    import trimesh
    from trimesh.visual import TextureVisuals

    scene, mesh = trimesh.Scene(), drop_degenerate(mesh)
    for part, name in enumerate(mesh.part_names):
        faces = mesh.faces[mesh.parts == part]
        if len(faces):
            piece = trimesh.Trimesh(mesh.vertices, faces, process=False)
            piece.remove_unreferenced_vertices()
            piece.visual = TextureVisuals(material=_material(name, part))
            scene.add_geometry(piece, geom_name=name, node_name=name)
    if y_up:
        scene.apply_transform(Y_UP)
    return scene


def _material(name: str, part: int) -> Any:
    from trimesh.visual.material import PBRMaterial

    colour = [*PALETTE[part % len(PALETTE)], 1.0]
    return PBRMaterial(name=name, baseColorFactor=colour, metallicFactor=0.0, roughnessFactor=0.7, doubleSided=True)
