"""Assets as glTF 2.0, binary or with the data inside the JSON: Y up, metres, a root node with a node for each part."""

from __future__ import annotations

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from dipcg.export.scene import Scene, places_y_up, y_up
from dipcg.materials import Finish, linear
from dipcg.mesh.copies import Places
from dipcg.mesh.pieces import Piece, split
from dipcg.mesh.surface import Maps

# Numbers of the specification: the component types of 32-bit reals and unsigned 32-bit integers, the targets of buffer
# views, and the filters of a sampler.
FLOAT, INDEX = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LINEAR, MIPMAPS = 9729, 9987
INSTANCING = "EXT_mesh_gpu_instancing"


def write_gltf(scene: Scene, path: Path, gpu_instancing: bool = False) -> None:
    """Write .glb, or .gltf as one file; a shape with copies is one mesh with a node for each copy.

    With `gpu_instancing` all copies are one node with the extension `EXT_mesh_gpu_instancing`, which not every viewer
    knows. Source: the specification of glTF 2.0, Khronos 2021. Raises OSError.
    """
    document = _Document(gpu_instancing)
    document.add_scene(scene)
    path.write_bytes(document.as_glb() if path.suffix.lower() == ".glb" else document.as_gltf())


def glb(scene: Scene) -> bytes:
    """The content of a .glb."""
    document = _Document(gpu_instancing=False)
    document.add_scene(scene)
    return document.as_glb()


class _Document:
    """The JSON of a file and the bytes that it points into."""

    def __init__(self, gpu_instancing: bool) -> None:
        self.bytes = bytearray()
        names = ("bufferViews", "accessors", "images", "samplers", "textures", "materials", "meshes", "nodes")
        self.lists: dict[str, list[dict[str, Any]]] = {name: [] for name in names}
        self.gpu_instancing = gpu_instancing
        self.extensions: set[str] = set()

    def add_scene(self, scene: Scene) -> None:
        """A root node with a node for each piece; pieces of one part share their material."""
        root = self._add("nodes", {"name": scene.name, "children": []})
        shared, plain = self.add_textured(scene.maps) if scene.maps else None, dict[int, int]()
        for piece in scene.pieces:
            if shared is None and piece.part not in plain:
                plain[piece.part] = self.add_plain(scene.finish(piece))
            material = plain[piece.part] if shared is None else shared
            self.lists["nodes"][root]["children"].append(self.add_piece(piece, material))

    def add_piece(self, piece: Piece, material: int) -> int:
        """The node of a piece: with its mesh, or with a child for each copy of it."""
        shape = split(piece)
        attributes = {"POSITION": self._vectors(y_up(shape.vertices), bounds=True)}
        attributes["NORMAL"] = self._vectors(y_up(shape.normals))
        # The origin of glTF is the upper left corner.
        attributes["TEXCOORD_0"] = self._vectors(shape.uv * [1, -1] + [0, 1])
        primitive = {"attributes": attributes, "indices": self._indices(shape.faces), "material": material}
        mesh = self._add("meshes", {"name": piece.name, "primitives": [primitive]})
        if piece.places is None:
            return self._add("nodes", {"name": piece.name, "mesh": mesh})
        if self.gpu_instancing:
            return self._add("nodes", {"name": piece.name, "mesh": mesh} | self._instancing(piece.places))
        return self._add("nodes", {"name": piece.name, "children": self._copies(piece, mesh)})

    def _copies(self, piece: Piece, mesh: int) -> list[int]:
        assert piece.places is not None
        every = zip(*_as_nodes(piece.places), strict=True)
        keys = ("translation", "rotation", "scale")
        return [
            self._add("nodes", {"name": f"{piece.name}_{number}", "mesh": mesh} | dict(zip(keys, values, strict=True)))
            for number, values in enumerate(every, 1)
        ]

    def _instancing(self, places: Places) -> dict[str, Any]:
        self.extensions.add(INSTANCING)
        keys = ("TRANSLATION", "ROTATION", "SCALE")
        columns = zip(keys, _as_nodes(places), strict=True)
        attributes = {key: self._vectors(np.array(values), target=None) for key, values in columns}
        return {"extensions": {INSTANCING: {"attributes": attributes}}}

    def add_plain(self, finish: Finish) -> int:
        colour = [*linear(np.array(finish.colour)).tolist(), 1.0]
        surface = {"baseColorFactor": colour, "metallicFactor": finish.metallic, "roughnessFactor": finish.roughness}
        return self._add("materials", {"name": finish.name, "pbrMetallicRoughness": surface, "doubleSided": True})

    def add_textured(self, maps: Maps) -> int:
        self._add("samplers", {"magFilter": LINEAR, "minFilter": MIPMAPS})
        # The green channel is roughness, the blue one is metallic.
        rough = np.dstack([np.full_like(maps.roughness, 255), maps.roughness, maps.metallic])
        surface = {"baseColorTexture": self._texture("base_colour", maps.base_colour)}
        surface["metallicRoughnessTexture"] = self._texture("metallic_roughness", rough)
        normal = self._texture("normal", maps.normal)
        material = {"name": "baked", "pbrMetallicRoughness": surface, "normalTexture": normal, "doubleSided": True}
        return self._add("materials", material)

    def as_glb(self) -> bytes:
        text = json.dumps(self._json({})).encode()
        text += b" " * (-len(text) % 4)
        length = 12 + 8 + len(text) + 8 + len(self.bytes)
        header = struct.pack("<4sIII4s", b"glTF", 2, length, len(text), b"JSON")
        return header + text + struct.pack("<I4s", len(self.bytes), b"BIN\0") + bytes(self.bytes)

    def as_gltf(self) -> bytes:
        content = base64.b64encode(self.bytes).decode()
        return json.dumps(self._json({"uri": f"data:application/octet-stream;base64,{content}"})).encode()

    def _json(self, buffer: dict[str, str]) -> dict[str, Any]:
        top = {"asset": {"version": "2.0", "generator": "dipcg"}, "scene": 0}
        top["scenes"] = [{"nodes": [0]}]
        top |= {"extensionsUsed": sorted(self.extensions)} if self.extensions else {}
        top["buffers"] = [{"byteLength": len(self.bytes)} | buffer]
        return top | {name: entries for name, entries in self.lists.items() if entries}

    def _add(self, name: str, entry: dict[str, Any]) -> int:
        self.lists[name].append(entry)
        return len(self.lists[name]) - 1

    def _view(self, content: bytes, **target: int) -> int:
        view = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(content)} | target
        self.bytes += content + b"\0" * (-len(content) % 4)
        return self._add("bufferViews", view)

    def _vectors(self, values: np.ndarray, bounds: bool = False, target: int | None = ARRAY_BUFFER) -> int:
        values = np.ascontiguousarray(values, "<f4")
        view = self._view(values.tobytes(), **{} if target is None else {"target": target})
        entry = {"bufferView": view, "componentType": FLOAT, "count": len(values), "type": f"VEC{values.shape[1]}"}
        limits = {"min": values.min(0).tolist(), "max": values.max(0).tolist()} if bounds else {}
        return self._add("accessors", entry | limits)

    def _indices(self, faces: np.ndarray) -> int:
        view = self._view(faces.astype("<u4").tobytes(), target=ELEMENT_ARRAY_BUFFER)
        entry = {"bufferView": view, "componentType": INDEX, "count": faces.size, "type": "SCALAR"}
        return self._add("accessors", entry)

    def _texture(self, name: str, image: np.ndarray) -> dict[str, int]:
        view = self._view(png(image))
        source = self._add("images", {"name": name, "mimeType": "image/png", "bufferView": view})
        return {"index": self._add("textures", {"source": source, "sampler": 0})}


def png(image: np.ndarray) -> bytes:
    """A picture as the bytes of a PNG file."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(file, "PNG")
    return file.getvalue()


def _as_nodes(places: Places) -> tuple[list[list[float]], list[list[float]], list[list[float]]]:
    """Translations, rotations as quaternions (x, y, z, w), and scales, with Y up."""
    from scipy.spatial.transform import Rotation

    turned = places_y_up(places)
    quaternions = Rotation.from_matrix(turned.rotation).as_quat()
    return _short(turned.translation), _short(quaternions), _short(turned.scale)


def _short(values: np.ndarray) -> list[list[float]]:
    """The values with seven digits, which are as many as a 32-bit real has."""
    return [[float(f"{value:.7g}") for value in row] for row in values]
