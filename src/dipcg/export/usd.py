"""Assets as USD through usd-core: Y up, metres, under one root a mesh and a UsdPreviewSurface for each part."""

from __future__ import annotations

import errno
import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from dipcg.export.gltf import png
from dipcg.export.scene import Scene, places_y_up, y_up
from dipcg.materials import Finish, linear
from dipcg.mesh.pieces import Piece, polygons
from dipcg.mesh.surface import Maps

# pyright: reportAttributeAccessIssue=false
# USD's modules are compiled and have no types.

# For each field of Maps: the input of UsdPreviewSurface, its type, the output of the texture, its colour space.
MAPS = {
    "base_colour": ("diffuseColor", "Color3f", "rgb", "sRGB"),
    "roughness": ("roughness", "Float", "r", "raw"),
    "metallic": ("metallic", "Float", "r", "raw"),
    "normal": ("normal", "Normal3f", "rgb", "raw"),
}


def write_usd(scene: Scene, path: Path) -> None:
    """Write .usda, .usdc or .usd, with maps as PNG files beside it, or .usdz with all in one file.

    A shape with copies is one mesh that instanceable prims refer to. Raises OSError when a file cannot be written.
    """
    if path.suffix.lower() == ".usdz":
        return _write_package(scene, path)
    files = _write_maps(scene.maps, path) if scene.maps else {}
    stage, root = _stage(scene.name)
    shared = _textured(stage, f"{root}/materials", files) if files else None
    plain: dict[int, Any] = {}
    for piece, name in _named(scene):
        finish = scene.finish(piece)
        material = shared or plain.get(piece.part) or _plain(stage, f"{root}/materials", finish)
        plain[piece.part] = material
        _add_piece(stage, f"{root}/{name}", piece, material)
    _save(stage.GetRootLayer().Export, path)


def _write_package(scene: Scene, path: Path) -> None:
    from pxr import Sdf, UsdUtils

    with tempfile.TemporaryDirectory() as folder:
        layer = Path(folder) / f"{_identifier(scene.name)}.usdc"
        write_usd(scene, layer)
        _without_date(Path(folder))
        _save(partial(UsdUtils.CreateNewUsdzPackage, Sdf.AssetPath(str(layer))), path)


def _without_date(folder: Path) -> None:
    """Set all files to the first date that a zip file knows: a package copies dates, equal assets are equal bytes."""
    first = time.mktime((1980, 1, 1, 0, 0, 0, 0, 0, -1))
    for path in folder.rglob("*"):
        os.utime(path, (first, first))


def _save(save: Callable[[str], bool], path: Path) -> None:
    """Call USD to write a file; its own error is a page of source lines. Raises OSError."""
    from pxr import Tf

    try:
        done = save(str(path))
    except Tf.ErrorException:
        done = False
    if not done:
        raise OSError(errno.EIO, "USD could not write it; is the disk full?", str(path))


def _stage(name: str) -> tuple[Any, str]:
    """An empty stage, and the path of its root prim."""
    from pxr import Kind, Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, f"/{_identifier(name)}")
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    stage.SetDefaultPrim(root.GetPrim())
    UsdGeom.Scope.Define(stage, f"{root.GetPath()}/materials")
    return stage, str(root.GetPath())


def _identifier(name: str) -> str:
    from pxr import Tf

    return Tf.MakeValidIdentifier(name)


def _named(scene: Scene) -> list[tuple[Piece, str]]:
    """The pieces with names that are valid in USD."""
    from dipcg.mesh.pieces import unique_names

    names = ["materials", *(_identifier(piece.name) for piece in scene.pieces)]
    return list(zip(scene.pieces, unique_names(tuple(names))[1:], strict=True))


def _add_piece(stage: Any, path: str, piece: Piece, material: Any) -> None:
    """A mesh, or a class with the mesh and a prim for each copy, which inherits the class and can be instanced."""
    from pxr import Sdf, UsdGeom

    if piece.places is None:
        return _add_mesh(stage, path, piece, material)
    UsdGeom.Xform.Define(stage, path)
    shape = UsdGeom.Xform.Define(stage, f"{path}/shape").GetPrim()
    shape.SetSpecifier(Sdf.SpecifierClass)
    _add_mesh(stage, f"{path}/shape/mesh", piece, material)
    name = path.rpartition("/")[2]
    # One by one, the stage would be composed again for each copy: two minutes for the seeds of a flower.
    with Sdf.ChangeBlock():
        for number, matrix in enumerate(places_y_up(piece.places).matrices(), 1):
            _add_copy(stage.GetRootLayer(), f"{path}/{name}_{number}", shape.GetPath(), matrix)


def _add_copy(layer: Any, path: str, shape: Any, matrix: Float[np.ndarray, "4 4"]) -> None:
    from pxr import Gf, Sdf

    copy, types = Sdf.CreatePrimInLayer(layer, path), Sdf.ValueTypeNames
    copy.specifier, copy.typeName, copy.instanceable = Sdf.SpecifierDef, "Xform", True
    copy.inheritPathList.prependedItems.append(shape)
    Sdf.AttributeSpec(copy, "xformOp:transform", types.Matrix4d).default = Gf.Matrix4d(matrix.T.tolist())
    order = Sdf.AttributeSpec(copy, "xformOpOrder", types.TokenArray, Sdf.VariabilityUniform)
    order.default = ["xformOp:transform"]


def _add_mesh(stage: Any, path: str, piece: Piece, material: Any) -> None:
    from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

    shape, points = UsdGeom.Mesh.Define(stage, path), y_up(piece.vertices)
    sizes, corners = polygons(piece.faces, piece.quads)
    shape.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points, np.float32)))
    shape.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(sizes.astype(np.int32)))
    shape.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(piece.faces.ravel()[corners]))
    normals = np.ascontiguousarray(y_up(piece.normals).reshape(-1, 3)[corners], np.float32)
    shape.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
    shape.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
    shape.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    shape.CreateDoubleSidedAttr(True)
    shape.CreateExtentAttr([Gf.Vec3f(*map(float, end)) for end in (points.min(0), points.max(0))])
    kind = Sdf.ValueTypeNames.TexCoord2fArray
    places = UsdGeom.PrimvarsAPI(shape).CreatePrimvar("st", kind, UsdGeom.Tokens.faceVarying)
    places.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(piece.uv.reshape(-1, 2)[corners], np.float32)))
    UsdShade.MaterialBindingAPI.Apply(shape.GetPrim()).Bind(material)


def _plain(stage: Any, folder: str, finish: Finish) -> Any:
    from pxr import Gf, Sdf

    material, shader = _material(stage, f"{folder}/{_identifier(finish.name)}")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(
        Gf.Vec3f(*linear(np.array(finish.colour)).tolist())
    )
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(finish.roughness)
    shader.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(finish.metallic)
    return material


def _material(stage: Any, path: str) -> tuple[Any, Any]:
    from pxr import UsdShade

    material = UsdShade.Material.Define(stage, path)
    shader = _shader(stage, f"{path}/surface", "UsdPreviewSurface")
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return material, shader


def _shader(stage: Any, path: str, kind: str) -> Any:
    from pxr import UsdShade

    shader = UsdShade.Shader.Define(stage, path)
    shader.CreateIdAttr(kind)
    return shader


def _textured(stage: Any, folder: str, files: dict[str, str]) -> Any:
    from pxr import Sdf

    types = Sdf.ValueTypeNames
    material, surface = _material(stage, f"{folder}/baked")
    reader = _shader(stage, f"{folder}/baked/st", "UsdPrimvarReader_float2")
    reader.CreateInput("varname", types.String).Set("st")
    reader.CreateOutput("result", types.Float2)
    for name, file in files.items():
        target, kind, output, space = MAPS[name]
        texture = _texture(stage, f"{folder}/baked/{name}", file, space)
        texture.CreateInput("st", types.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
        texture.CreateOutput(output, types.Float if output == "r" else types.Float3)
        surface.CreateInput(target, getattr(types, kind)).ConnectToSource(texture.ConnectableAPI(), output)
    return material


def _texture(stage: Any, path: str, file: str, space: str) -> Any:
    from pxr import Gf, Sdf

    types = Sdf.ValueTypeNames
    texture = _shader(stage, path, "UsdUVTexture")
    texture.CreateInput("file", types.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("sourceColorSpace", types.Token).Set(space)
    for wrap in ("wrapS", "wrapT"):
        texture.CreateInput(wrap, types.Token).Set("repeat")
    if path.endswith("/normal"):
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
