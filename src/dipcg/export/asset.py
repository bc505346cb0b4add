"""Assets as files that other programs open, a material for each part: GLB, OBJ, PLY, STL, USD, Blender's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from dipcg.files import write_file, written
from dipcg.mesh import Mesh, simplify
from dipcg.render import PALETTE
from dipcg.space import Params, params_to_json
from dipcg.surface import Maps, Piece, pieces

GLTF, USD, BLEND = (".glb", ".gltf"), (".usdz", ".usda", ".usdc"), ".blend"
FORMATS = (*GLTF, ".obj", ".ply", ".stl", *USD, BLEND)
# The formats that hold texture maps.
TEXTURED = (*GLTF, *USD)
# The least and the most pixels along a side of a map.
MAP_SIZES = (16, 8192)
# By suffix, the module that a format needs and the command that installs it.
NEEDS = dict.fromkeys(USD, ("pxr", "pip install 'dipcg[usd]'"))
NEEDS |= {BLEND: ("bpy", "pip install 'dipcg[infinigen]' (Python 3.11)")}


class ExportError(ValueError):
    """A file cannot be written; the message says why and what to do."""


@dataclass(frozen=True)
class Asset:
    """A mesh with the parameters that made it, and the name or path of their generator.

    `maps` are the texture maps of `export.textures.texture`; `material_seed` chooses Infinigen's materials in a Blender
    file.
    """

    mesh: Mesh
    generator: str
    params: Params
    maps: Maps | None = None
    material_seed: int = 0

    def with_faces(self, faces: int) -> Asset:
        """The asset simplified to about this number of triangles at most; without maps."""
        return replace(self, mesh=simplify(self.mesh, faces, error=1.0), maps=None)

    def export(self, path: str | Path) -> Path:
        """Write the asset in the format that the suffix names, in metres; glTF is Y up, the others Z up.

        A .blend starts Blender, which takes seconds. Raises ExportError with a sentence when the format is unknown or
        the file cannot be written, and workers.rpc.BlenderError.
        """
        path = check_target(path)
        try:
            with written(path) as unfinished:
                _writer(path)(self, unfinished)
        except OSError as error:
            raise ExportError(f"{path} cannot be written ({error.strerror or error}).") from None
        return path

    def save_params(self, path: str | Path) -> Path:
        """Write the parameters as JSON, for `dipcg edit`."""
        write_file(path, params_to_json(self.params, self.generator))
        return Path(path)


def check_target(path: str | Path, formats: tuple[str, ...] = FORMATS) -> Path:
    """The path, if a file of one of the formats can be written to it; else raises ExportError."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in formats:
        raise ExportError(f"{path.name} has no known ending; use one of {', '.join(formats)}.")
    if suffix in NEEDS and find_spec(NEEDS[suffix][0]) is None:
        raise ExportError(f"{suffix} files need the module {NEEDS[suffix][0]}: run {NEEDS[suffix][1]}.")
    if not path.parent.is_dir():
        raise ExportError(f"The folder {path.parent} does not exist; make it first, or choose another.")
    try:
        existed = path.exists()
        path.open("ab").close()
        if not existed:
            path.unlink()
        # The file is made in a folder beside it.
        TemporaryDirectory(dir=path.resolve().parent).cleanup()
    except OSError as error:
        raise ExportError(f"{path} cannot be written ({error.strerror}).") from None
    return path


def check_faces(faces: int) -> None:
    """Raise ExportError for fewer triangles than enclose a volume."""
    if faces < 4:
        raise ExportError(f"The number of triangles to keep must be 4 or more, got {faces}.")


def check_texture(size: int, path: Path) -> None:
    """Raise ExportError for maps of a size out of range, in a format that holds none, or without Blender."""
    if not MAP_SIZES[0] <= size <= MAP_SIZES[1]:
        raise ExportError(f"The maps' size must be from {MAP_SIZES[0]} to {MAP_SIZES[1]} pixels, got {size}.")
    if path.suffix.lower() not in TEXTURED:
        raise ExportError(f"{path.suffix} files hold no maps; use one of {', '.join(TEXTURED)}.")
    if find_spec("bpy") is None:
        raise ExportError(f"Baking maps needs the module bpy: run {NEEDS[BLEND][1]}.")


def _writer(path: Path) -> Callable[[Asset, Path], None]:
    """The function that writes files of this ending."""
    suffix = path.suffix.lower()
    if suffix in GLTF:
        return _write_gltf
    if suffix in USD:
        return _write_usd
    return _write_blend if suffix == BLEND else _write_with_trimesh


def _write_gltf(asset: Asset, path: Path) -> None:
    from dipcg.export.gltf import write_gltf

    write_gltf(asset.mesh, path, asset.maps)


def _write_usd(asset: Asset, path: Path) -> None:
    from dipcg.export.usd import write_usd

    write_usd(asset.mesh, path, asset.maps)


def _write_blend(asset: Asset, path: Path) -> None:
    from dipcg.export.blend import write_blend

    write_blend(asset.mesh, asset.generator, asset.params, asset.material_seed, path)


def _write_with_trimesh(asset: Asset, path: Path) -> None:
    """OBJ with materials; PLY and STL as one surface, without normals, so that neighbours share their vertices."""
    import trimesh

    mesh = asset.mesh
    if path.suffix.lower() == ".obj":
        scene = trimesh.Scene({piece.name: _with_material(piece) for piece in pieces(mesh)})
        # trimesh's own name of the material file would be the same for every asset of a folder.
        scene.export(path, mtl_name=f"{path.stem}.mtl", include_normals=True)
        return
    merged = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    merged.merge_vertices(digits_vertex=7)
    # Slivers in bevels stay, because a closed surface would be open without them.
    merged.update_faces((merged.faces != np.roll(merged.faces, 1, axis=1)).all(1))
    merged.remove_unreferenced_vertices()
    # PLY is written without attributes, because trimesh would look for texture coordinates among them.
    merged.export(path, **{"include_attributes": False} if path.suffix.lower() == ".ply" else {})


def _with_material(piece: Piece) -> Any:
    import trimesh
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import SimpleMaterial

    colour = np.append(np.rint(255 * PALETTE[piece.part % len(PALETTE)]), 255).astype(np.uint8)
    material = SimpleMaterial(name=piece.name, diffuse=colour, ambient=colour, specular=[0, 0, 0, 255])
    shape = trimesh.Trimesh(piece.vertices, piece.faces, vertex_normals=piece.normals, process=False)
    shape.visual = TextureVisuals(material=material)
    return shape
