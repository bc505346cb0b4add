"""Assets as USD through usd-core: Z up, metres, a mesh and a UsdPreviewSurface for each part."""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dipcg.export.gltf import linear, png
from dipcg.mesh import Mesh
from dipcg.render import PALETTE
from dipcg.surface import Maps, Piece, pieces

# pyright: reportAttributeAccessIssue=false
# USD's modules are compiled and have no types.

# For each field of Maps: the input of UsdPreviewSurface, its type, the output of the texture, its colour space.
MAPS = {
    "base_colour": ("diffuseColor", "Color3f", "rgb", "sRGB"),
    "roughness": ("roughness", "Float", "r", "raw"),
    "metallic": ("metallic", "Float", "r", "raw"),
    "normal": ("normal", "Normal3f", "rgb", "raw"),
}


def write_usd(mesh: Mesh, path: Path, maps: Maps | None = None) -> None:
    """Write .usda or .usdc, with maps as PNG files beside it, or .usdz with all in one file.

    Raises OSError when a file cannot be written.
    """
    if path.suffix.lower() == ".usdz":
        return _write_package(mesh, path, maps)
    files = _write_maps(maps, path) if maps else {}
    stage = _stage()
    shared = _textured(stage, files) if files else None
    for piece, name in _named(mesh, maps):
        _add_part(stage, piece, name, shared or _plain(stage, piece, name))
    _save(stage.GetRootLayer().Export, path)


def _write_package(mesh: Mesh, path: Path, maps: Maps | None) -> None:
    from pxr import Sdf, UsdUtils

    with tempfile.TemporaryDirectory() as folder:
        layer = Path(folder) / "asset.usdc"
        write_usd(mesh, layer, maps)
        _save(partial(UsdUtils.CreateNewUsdzPackage, Sdf.AssetPath(str(layer))), path)


def _save(save: Callable[[str], bool], path: Path) -> None:
    """Call USD to write a file; its own error is a page of source lines. Raises OSError."""
    from pxr import Tf

    try:
        done = save(str(path))
    except Tf.ErrorException:
        done = False
    if not done:
        raise OSError(errno.EIO, "USD could not write it; is the disk full?", str(path))


def _stage() -> Any:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, "/asset")
    stage.SetDefaultPrim(root.GetPrim())
    UsdGeom.Scope.Define(stage, "/asset/materials")
    return stage


def _named(mesh: Mesh, maps: Maps | None) -> list[tuple[Piece, str]]:
    """The pieces with names that are valid in USD."""
    from pxr import Tf

    from dipcg.surface import unique_names

    every = list(pieces(mesh, maps))
    names = ["materials", *(Tf.MakeValidIdentifier(piece.name) for piece in every)]
    return list(zip(every, unique_names(tuple(names))[1:], strict=True))


def _add_part(stage: Any, piece: Piece, name: str, material: Any) -> None:
    from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

    shape = UsdGeom.Mesh.Define(stage, f"/asset/{name}")
    shape.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(piece.vertices))
    shape.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(piece.faces), 3, np.int32)))
    shape.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(piece.faces.ravel()))
    shape.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(piece.normals))
    shape.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    shape.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    shape.CreateDoubleSidedAttr(True)
    shape.CreateExtentAttr([Gf.Vec3f(*map(float, end)) for end in (piece.vertices.min(0), piece.vertices.max(0))])
    if piece.uv is not None:
        kind = Sdf.ValueTypeNames.TexCoord2fArray
        places = UsdGeom.PrimvarsAPI(shape).CreatePrimvar("st", kind, UsdGeom.Tokens.vertex)
        places.Set(Vt.Vec2fArray.FromNumpy(piece.uv))
    UsdShade.MaterialBindingAPI.Apply(shape.GetPrim()).Bind(material)


def _plain(stage: Any, piece: Piece, name: str) -> Any:
    from pxr import Gf, Sdf

    material, shader = _material(stage, name)
    colour = Gf.Vec3f(*linear(PALETTE[piece.part % len(PALETTE)]).tolist())
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(colour)
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.7)
    return material


def _material(stage: Any, name: str) -> tuple[Any, Any]:
    from pxr import UsdShade

    material = UsdShade.Material.Define(stage, f"/asset/materials/{name}")
    shader = _shader(stage, f"/asset/materials/{name}/surface", "UsdPreviewSurface")
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material, shader


def _shader(stage: Any, path: str, kind: str) -> Any:
    from pxr import UsdShade

    shader = UsdShade.Shader.Define(stage, path)
    shader.CreateIdAttr(kind)
    return shader


def _textured(stage: Any, files: dict[str, str]) -> Any:
    from pxr import Sdf

    types = Sdf.ValueTypeNames
    material, surface = _material(stage, "baked")
    reader = _shader(stage, "/asset/materials/baked/st", "UsdPrimvarReader_float2")
    reader.CreateInput("varname", types.String).Set("st")
    reader.CreateOutput("result", types.Float2)
    for name, file in files.items():
        target, kind, output, space = MAPS[name]
        texture = _texture(stage, name, file, space)
        texture.CreateInput("st", types.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
        texture.CreateOutput(output, types.Float if output == "r" else types.Float3)
        surface.CreateInput(target, getattr(types, kind)).ConnectToSource(texture.ConnectableAPI(), output)
    return material


def _texture(stage: Any, name: str, file: str, space: str) -> Any:
    from pxr import Gf, Sdf

    types = Sdf.ValueTypeNames
    texture = _shader(stage, f"/asset/materials/baked/{name}", "UsdUVTexture")
    texture.CreateInput("file", types.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("sourceColorSpace", types.Token).Set(space)
    for wrap in ("wrapS", "wrapT"):
        texture.CreateInput(wrap, types.Token).Set("repeat")
    if name == "normal":
        # From [0, 1] to [-1, 1].
        texture.CreateInput("scale", types.Float4).Set(Gf.Vec4f(2, 2, 2, 1))
        texture.CreateInput("bias", types.Float4).Set(Gf.Vec4f(-1, -1, -1, 0))
    return texture


def _write_maps(maps: Maps, path: Path) -> dict[str, str]:
    files = {}
    for name in MAPS:
        file = path.with_name(f"{path.stem}_{name}.png")
        file.write_bytes(png(getattr(maps, name)))
        files[name] = f"./{file.name}"
    return files
