"""Commands that make assets from parameters: sample, edit."""

from __future__ import annotations

import json as jsons
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional, UseAppendAction, arg

from dipcg.cli.outputs import check_outputs
from dipcg.generators import Detail

if TYPE_CHECKING:
    from dipcg.export.asset import Asset
    from dipcg.generators import Generator
    from dipcg.materials import Colour
    from dipcg.results import Estimate
    from dipcg.space import Params

Name = Annotated[str, arg(aliases=["-g"], metavar="NAME")]
Output = Annotated[Path, arg(aliases=["-o"], metavar="FILE")]
Preview = Annotated[Path | None, arg(metavar="FILE")]
# Each flag takes one or more settings, and the flag can be repeated.
Settings = Annotated[tuple[tuple[str, ...], ...], UseAppendAction, arg(metavar="NAME=VALUE")]
Paint = Annotated[tuple[tuple[str, ...], ...], UseAppendAction, arg(metavar="PART=COLOUR")]


@dataclass(frozen=True)
class Written:
    """The files to write."""

    output: Output
    """mesh to write: .glb, .gltf, .obj, .ply, .stl, .usdz, .usd, .usda, .usdc, .fbx or .blend"""
    params_out: Path | None = None
    """JSON file for the parameters"""
    detail: Detail = "standard"
    """full: all triangles and quads; standard: few triangles that look like all; light: a coarse mesh"""
    light: bool = False
    """the same as --detail light"""
    faces: Annotated[int | None, arg(metavar="COUNT")] = None
    """triangles to simplify to; all of the detail when left out"""
    texture: Annotated[int | None, arg(metavar="PIXELS")] = None
    """side in pixels of texture maps that are baked from Infinigen's materials, for glTF and USD"""
    colours: Literal["photo", "material", "parts"] = "photo"
    """colours without maps: of the photo, or of materials where there is none; of materials; one for each part"""
    material_seed: int = 0
    """random seed of the materials in maps and in .blend files"""
    lods: Annotated[int, arg(metavar="COUNT")] = 0
    """also write so many coarser levels of detail, from 1 to 3: NAME_LOD1, NAME_LOD2, ..."""
    collision: Literal["unreal", "godot"] | None = None
    """add a convex hull around each solid, named for this game engine, to glTF, OBJ or FBX"""
    gpu_instancing: bool = False
    """hold copies, such as seeds, in one node of glTF by EXT_mesh_gpu_instancing, which not every viewer knows"""
    json: bool = False
    """print the result as JSON"""

    @property
    def built(self) -> Detail:
        """The detail to build; a mesh that is simplified to a number of triangles is built in full first."""
        return "light" if self.light else "full" if self.faces else self.detail

    def levels(self, output: Path) -> list[Path]:
        """The files of coarser levels of detail beside an output."""
        return [output.with_stem(f"{output.stem}_LOD{level}") for level in range(1, self.lods + 1)]

    def check(self) -> None:
        """Raise ExportError for a file that could not be written, before any work is done."""
        from dipcg.export.asset import check_extras, check_faces, check_target, check_texture

        for file in (self.output, *self.levels(self.output)):
            check_target(file)
        check_extras(self.output, self.lods, bool(self.collision), self.gpu_instancing, bool(self.texture))
        if self.params_out is not None:
            check_target(self.params_out, (".json",))
        if self.faces is not None:
            check_faces(self.faces)
        if self.texture is not None:
            check_texture(self.texture, self.output)

    def finish(self, asset: Asset, estimate: Estimate | None = None) -> Asset:
        """The asset simplified, with colours and texture maps, as the flags say; raises BlenderError."""
        from dipcg.inference.colours import with_colours

        asset = with_colours(replace(asset, material_seed=self.material_seed), estimate, self.colours)
        asset = asset if self.faces is None else asset.with_faces(self.faces)
        return asset if self.texture is None else _textured(asset, self.texture)

    def write(self, asset: Asset, output: Path) -> None:
        """Write a finished asset, with hulls and levels of detail as the flags say; raises ExportError."""
        with_hulls = asset if self.collision is None else asset.with_hulls(self.collision)
        with_hulls.export(output, self.gpu_instancing)
        for level, file in enumerate(self.levels(output), 1):
            asset.coarser(level).export(file, self.gpu_instancing)


Options = Annotated[Written, OmitArgPrefixes]


def _textured(asset: Asset, size: int) -> Asset:
    from dipcg.cli.terminal import bar
    from dipcg.export.textures import texture

    started = time.perf_counter()
    with bar("baking", 100) as update:
        made = texture(asset, size, asset.material_seed, lambda share, note: update(int(100 * share), note))
    print(f"Baked {size} × {size} maps in {time.perf_counter() - started:.0f} s.", file=sys.stderr)
    return made


def sample(
    name: Positional[str],
    /,
    *,
    output: Options,
    seed: int = 0,
    set: Settings = (),
    paint: Paint = (),
    preview: Preview = None,
) -> None:
    """Build a random asset, or one with given parameters.

    Args:
        name: a generator's name, or the path of a Python or TOML file
        seed: random seed of the parameters
        set: fixed parameters, as name=value
        paint: colours of parts, as seat=#b51f1a; those of other parts follow from them
        preview: PNG file for a picture of the asset
    """
    import numpy as np

    from dipcg.generators import load_generator
    from dipcg.materials import colours_in_hex

    check_outputs((output.output, *output.levels(output.output), output.params_out), (name,))
    generator = load_generator(name)
    params = generator.space.sample(np.random.default_rng(seed))
    _check_preview(preview)
    fixed, painted = generator.space.replace(params, parse_settings(set)), colours_in_hex(parse_settings(paint))
    _note_unknown(painted, _build_and_write(generator, fixed, output, preview=preview, colours=painted))


def edit(
    file: Positional[Path],
    /,
    *,
    output: Options,
    set: Settings = (),
    paint: Paint = (),
    preview: Preview = None,
) -> None:
    """Change parameters of an asset and build it again.

    Args:
        file: parameters as JSON, from --params-out
        set: parameters to change, as name=value
        paint: colours of parts to change, as seat=#b51f1a
        preview: PNG file for the asset before and after, from the same camera
    """
    from dipcg.generators import load_generator
    from dipcg.materials import check_colours, colours_in_hex
    from dipcg.parameter_file import document_from_json

    document = document_from_json(_read(file))
    name, painted = document["generator"], colours_in_hex(parse_settings(paint))
    colours = check_colours(document.get("colours", {})) | painted
    check_outputs((output.output, *output.levels(output.output), output.params_out, preview), (file, name))
    generator = load_generator(name)
    before = generator.space.validate(document["params"])
    after = generator.space.replace(before, parse_settings(set))
    _check_preview(preview)
    _note_unknown(painted, _build_and_write(generator, after, output, before, preview, colours))


def parse_settings(settings: Sequence[Sequence[str]]) -> dict[str, str]:
    """The `name=value` words of several flags as a dict.

    Raises ValueError for a word without `=` and for a name with two values.
    """
    words = [word for flag in settings for word in flag]
    for word in words:
        if "=" not in word:
            raise ValueError(f"A setting is written name=value, got {word!r}.")
    values: dict[str, str] = {}
    for name, value in ((part.strip() for part in word.split("=", 1)) for word in words):
        if values.setdefault(name, value) != value:
            raise ValueError(f"{name} is given twice, as {values[name]} and as {value}; give it once.")
    return values


def _check_preview(preview: Path | None) -> None:
    from dipcg.export.asset import check_target

    if preview is not None:
        check_target(preview, (".png",))


def _read(file: Path) -> str:
    try:
        return file.read_text()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise ValueError(f"{file} cannot be read as a parameter file ({reason}).") from None


def _build_and_write(
    generator: Generator,
    params: Params,
    written: Written,
    before: Params | None = None,
    preview: Path | None = None,
    colours: Mapping[str, Colour] | None = None,
) -> Asset:
    """Build and write an asset, print that, and draw it, beside the asset of the parameters before if there are any."""
    from dipcg.export.asset import Asset
    from dipcg.workers.pool import BuildPool

    written.check()
    with BuildPool(generator) as pool:
        every = [before, params] if preview and before else [params]
        assets = [Asset(pool.build(one, written.built), generator.ref, one, colours=colours or {}) for one in every]
    asset = written.finish(assets[-1])
    written.write(asset, written.output)
    if written.params_out is not None:
        asset.save_params(written.params_out)
    if preview:
        _draw([*assets[:-1], asset], written, generator, preview)
    faces = len(asset.mesh.faces)
    made = {"generator": generator.name, "output": str(written.output), "faces": faces, "params": params}
    print(jsons.dumps(made) if written.json else f"Wrote {written.output}, {faces:,} triangles.")
    return asset


def _note_unknown(painted: Mapping[str, Colour], asset: Asset) -> None:
    """Say which painted parts the asset lacks: they may be misspelt, or come back with an edit."""
    names = asset.mesh.part_names
    if unknown := sorted(painted.keys() - set(names)):
        print(f"The asset has no part {', '.join(unknown)}, only {', '.join(names)}.", file=sys.stderr)


def _draw(assets: list[Asset], written: Written, generator: Generator, path: Path) -> None:
    import numpy as np

    from dipcg.images import save_image
    from dipcg.inference.colours import with_colours
    from dipcg.inference.preview import same_camera

    coloured = [with_colours(asset, colours=written.colours) for asset in assets]
    save_image(np.concatenate(same_camera(coloured, generator.views.middle), 1), path)
