"""Assets as glTF 2.0, binary or with the data inside the JSON: Y up, metres, a mesh and a material for each part."""

from __future__ import annotations

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from dipcg.mesh import Mesh
from dipcg.render import PALETTE
from dipcg.surface import Maps, Piece, pieces

# Numbers of the specification: the component types of 32-bit reals and unsigned 32-bit integers, the targets of buffer
# views, and the filters of a sampler.
FLOAT, INDEX = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LINEAR, MIPMAPS = 9729, 9987


def write_gltf(mesh: Mesh, path: Path, maps: Maps | None = None) -> None:
    """Write .glb, or .gltf as one file; with maps all parts share one textured material.

    Source: the specification of glTF 2.0, Khronos 2021. Raises OSError.
    """
    document = _Document()
    shared = document.add_textured(maps) if maps else None
    for piece in pieces(mesh, maps):
        document.add_part(piece, document.add_plain(piece) if shared is None else shared)
    path.write_bytes(document.as_glb() if path.suffix.lower() == ".glb" else document.as_gltf())


def linear(srgb: Float[np.ndarray, "*c"]) -> Float[np.ndarray, "*c"]:
    """Colours in [0, 1] from sRGB (IEC 61966-2-1) to linear, as materials have them."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


class _Document:
    """The JSON of a file and the bytes that it points into."""

    def __init__(self) -> None:
        self.bytes = bytearray()
        names = ("bufferViews", "accessors", "images", "samplers", "textures", "materials", "meshes", "nodes")
        self.lists: dict[str, list[dict[str, Any]]] = {name: [] for name in names}

    def add_part(self, piece: Piece, material: int) -> None:
        attributes = {"POSITION": self._vectors(_y_up(piece.vertices), bounds=True)}
        attributes["NORMAL"] = self._vectors(_y_up(piece.normals))
        if piece.uv is not None:
            # The origin of glTF is the upper left corner.
            attributes["TEXCOORD_0"] = self._vectors(np.column_stack([piece.uv[:, 0], 1 - piece.uv[:, 1]]))
        primitive = {"attributes": attributes, "indices": self._indices(piece.faces), "material": material}
        mesh = self._add("meshes", {"name": piece.name, "primitives": [primitive]})
        self._add("nodes", {"name": piece.name, "mesh": mesh})

    def add_plain(self, piece: Piece) -> int:
        colour = [*linear(PALETTE[piece.part % len(PALETTE)]).tolist(), 1.0]
        surface = {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.7}
        return self._add("materials", {"name": piece.name, "pbrMetallicRoughness": surface, "doubleSided": True})

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
        top["scenes"] = [{"nodes": list(range(len(self.lists["nodes"])))}]
        top["buffers"] = [{"byteLength": len(self.bytes)} | buffer]
        return top | {name: entries for name, entries in self.lists.items() if entries}

    def _add(self, name: str, entry: dict[str, Any]) -> int:
        self.lists[name].append(entry)
        return len(self.lists[name]) - 1

    def _view(self, content: bytes, **target: int) -> int:
        view = {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(content)} | target
        self.bytes += content + b"\0" * (-len(content) % 4)
        return self._add("bufferViews", view)

    def _vectors(self, values: np.ndarray, bounds: bool = False) -> int:
        values = np.ascontiguousarray(values, "<f4")
        view = self._view(values.tobytes(), target=ARRAY_BUFFER)
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


def _y_up(vectors: np.ndarray) -> np.ndarray:
    return np.column_stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]])
