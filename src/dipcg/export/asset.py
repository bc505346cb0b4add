"""Assets as files that other programs open, a material for each part: GLB, OBJ, PLY, STL, USD, Blender's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from dipcg.export.collision import Engine, with_hulls
from dipcg.export.scene import Scene, compose, on_floor
from dipcg.files import write_file, written
from dipcg.materials import Colour, Finish, coloured
from dipcg.mesh import Mesh
from dipcg.mesh.detail import TOLERANCE, standard
from dipcg.mesh.simplify import simplify
from dipcg.mesh.surface import Maps
from dipcg.parameter_file import params_to_json
from dipcg.space import Params

GLTF, USD, BLEND = (".glb", ".gltf"), (".usdz", ".usd", ".usda", ".usdc"), ".blend"
FBX = ".fbx"
FORMATS = (*GLTF, ".obj", ".ply", ".stl", *USD, FBX, BLEND)
# The formats that hold texture maps.
TEXTURED = (*GLTF, *USD)
# The formats that game engines read with the names of collision shapes.
GAMES = (*GLTF, ".obj", FBX)
# The most levels of detail beside an asset.
MOST_LEVELS = 3
# The least and the most pixels along a side of a map.
MAP_SIZES = (16, 8192)
# By suffix, the module that a format needs and the command that installs it.
NEEDS = dict.fromkeys(USD, ("pxr", "pip install 'dipcg[usd]'"))
NEEDS |= dict.fromkeys((FBX, BLEND), ("bpy", "pip install 'dipcg[infinigen]' (Python 3.11)"))


class ExportError(ValueError):
    """A file cannot be written; the message says why and what to do."""


@dataclass(frozen=True)
class Asset:
    """A mesh with the parameters that made it, and the name or path of their generator.

    `maps` are the texture maps of `export.textures.texture`; `material_seed` chooses Infinigen's materials in a Blender
    file. `colours` are those of parts by name, such as a photograph shows; those of others follow from them.
    """

    mesh: Mesh
    generator: str
    params: Params
    maps: Maps | None = None
    material_seed: int = 0
    colours: Mapping[str, Colour] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name of the generator, by which files call the asset."""
        return Path(self.generator).stem

    @property
    def materials(self) -> tuple[Finish, ...]:
        """The plain material of each part."""
        return coloured(self.generator, self.mesh.part_names, self.colours)

    def scene(self, copies: bool = False) -> Scene:
        """What a file holds; with `copies` each shape that has some is there once."""
        return compose(self.mesh, self.name, self.materials, self.maps, copies)

    def with_faces(self, faces: int) -> Asset:
        """The asset simplified to about this number of triangles at most; without maps."""
        return replace(self, mesh=simplify(self.mesh, faces, error=1.0), maps=None)

    def coarser(self, level: int) -> Asset:
        """The asset at a level of detail, without maps: each level may leave the surface three times as far."""
        return replace(self, mesh=standard(self.mesh, TOLERANCE * 3**level), maps=None)

    def with_hulls(self, engine: Engine) -> Asset:
        """The asset with a convex hull around each solid, named as a game engine expects collision shapes."""
        mesh, maps = with_hulls(self.mesh, self.maps, engine)
        return replace(self, mesh=mesh, maps=maps)

    def export(self, path: str | Path, gpu_instancing: bool = False) -> Path:
        """Write the asset in the format that the suffix names, in metres, its middle over the origin.

        It stands on the floor. PLY, STL and Blender files are Z up, the others Y up. With `gpu_instancing` glTF holds
        all copies of a shape in one node by `EXT_mesh_gpu_instancing`.
        A .blend starts Blender, which takes seconds. Raises ExportError with a sentence when the format is unknown or
        the file cannot be written, and workers.rpc.BlenderError.
        """
        path = check_target(path)
        try:
            with written(path) as unfinished:
                _write(self, unfinished, gpu_instancing)
        except OSError as error:
            raise ExportError(f"{path} cannot be written ({error.strerror or error}).") from None
        return path

    @property
    def document(self) -> str:
        """The parameters, and colours if there are any, as the JSON text that `dipcg edit` reads."""
        others = {"colours": self.colours} if self.colours else {}
        return params_to_json(self.params, self.generator, **others)

    def save_params(self, path: str | Path) -> Path:
        """Write the parameters and colours as JSON, for `dipcg edit`."""
        write_file(path, self.document)
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


def check_extras(path: Path, levels: int, hulls: bool, gpu_instancing: bool, texture: bool) -> None:
    """Raise ExportError for levels of detail, hulls or instances in a format, or beside maps, that cannot have them."""
    suffix = path.suffix.lower()
    if not 0 <= levels <= MOST_LEVELS:
        raise ExportError(f"There can be up to {MOST_LEVELS} levels of detail, got {levels}.")
    if levels and (texture or suffix == BLEND):
        raise ExportError("Levels of detail have no maps and are no .blend files; leave --lods or the other out.")
    if hulls and suffix not in GAMES:
        raise ExportError(f"Game engines read hulls from {', '.join(GAMES)}, not from {suffix} files.")
    if gpu_instancing and suffix not in GLTF:
        raise ExportError(f"Instances for the graphics card need {' or '.join(GLTF)}, not {suffix}.")


def _write(asset: Asset, path: Path, gpu_instancing: bool) -> None:
    suffix = path.suffix.lower()
    if suffix in GLTF:
        from dipcg.export.gltf import write_gltf

        write_gltf(asset.scene(copies=True), path, gpu_instancing)
    elif suffix in USD:
        from dipcg.export.usd import write_usd

        write_usd(asset.scene(copies=True), path)
    elif suffix == BLEND:
        from dipcg.export.blend import write_blend, write_live

        if asset.generator.endswith(".toml"):
            write_live(asset.generator, asset.params, path)
        else:
            write_blend(on_floor(asset.mesh), asset.generator, asset.document, asset.material_seed, path)
    elif suffix == FBX:
        from dipcg.export.blend import write_fbx

        write_fbx(on_floor(asset.mesh), asset.name, asset.materials, path)
    elif suffix == ".obj":
        from dipcg.export.obj import write_obj

        write_obj(asset.scene(), path)
    else:
        from dipcg.export.solids import write_ply, write_stl

        {".ply": write_ply, ".stl": write_stl}[suffix](on_floor(asset.mesh), path)
