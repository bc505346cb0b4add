"""A mesh as a few kilobytes: 12 bits a coordinate, meshoptimizer's vertex and index codecs, then zstd."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

import numpy as np

from dipcg.mesh import Mesh
from dipcg.mesh.simplify import compact

# Bits of a coordinate.
BITS = 12
# Low corner, step, number of vertices, of faces, of bytes of the vertices, and of parts.
_HEADER = struct.Struct("<3f f I I I B")


def encode_mesh(mesh: Mesh) -> bytes:
    """Pack a mesh; coordinates are rounded to 2^-12 of the longest side."""
    import meshoptimizer
    import zstandard

    mesh = _in_cache_order(compact(mesh))
    low, step = mesh.bounds[0], mesh.side / (2**BITS - 1)
    # A fourth column, because meshoptimizer takes strides of a multiple of four bytes.
    grid = np.zeros((len(mesh.vertices), 4), np.uint16)
    grid[:, :3] = np.rint((mesh.vertices - low) / step)
    vertices = bytes(meshoptimizer.encode_vertex_buffer(grid, len(grid), 8))
    faces = bytes(meshoptimizer.encode_index_buffer(mesh.faces.astype(np.uint32).ravel(), mesh.faces.size, len(grid)))
    header = _HEADER.pack(*low, step, len(grid), len(mesh.faces), len(vertices), len(mesh.part_names))
    names = "\n".join(mesh.part_names).encode() + b"\0"
    counts = np.bincount(mesh.parts, minlength=len(mesh.part_names)).astype("<u4").tobytes()
    return zstandard.compress(header + names + counts + vertices + faces, 3)


def decode_mesh(data: bytes) -> Mesh:
    """Unpack a mesh that `encode_mesh` has packed."""
    import meshoptimizer

    data = _decompressor().decompress(data)
    *low, step, v, f, size, parts = _HEADER.unpack_from(data)
    end = data.index(b"\0", _HEADER.size)
    names = tuple(data[_HEADER.size : end].decode().split("\n"))
    counts = np.frombuffer(data, "<u4", parts, end + 1)
    start = end + 1 + counts.nbytes
    grid = meshoptimizer.decode_vertex_buffer(v, 8, data[start : start + size]).view(np.uint16).reshape(v, 4)
    faces = meshoptimizer.decode_index_buffer(3 * f, 4, data[start + size :]).view(np.int32).reshape(f, 3)
    vertices = grid[:, :3].astype(np.float32) * np.float32(step) + np.array(low, np.float32)
    return Mesh(vertices, faces, np.repeat(np.arange(parts, dtype=np.uint8), counts), names)


def _in_cache_order(mesh: Mesh) -> Mesh:
    """Renumber vertices by their first use, an order that the codecs compress best."""
    seen, first = np.unique(mesh.faces, return_index=True)
    order = seen[np.argsort(first)]
    new = np.empty(len(mesh.vertices), np.int32)
    new[order] = np.arange(len(order), dtype=np.int32)
    return Mesh(mesh.vertices[order], new[mesh.faces], mesh.parts, mesh.part_names)


@cache
def _decompressor() -> Any:
    import zstandard

    return zstandard.ZstdDecompressor()
