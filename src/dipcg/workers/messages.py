"""Messages between a program and its child processes: plain data and arrays, each message with its length in front.

A child may have opened a stranger's file, so what it sends is data and nothing else: nothing is unpickled, the types
are listed here, sizes are checked, and a mesh is checked like one that was just built. The child may run in another
Blender, whose Python has NumPy alone.
"""

from __future__ import annotations

import io
import json
import math
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np

from dipcg.camera import View
from dipcg.mesh import Mesh, MeshError, make_mesh
from dipcg.mesh.surface import Maps, make_maps

_LENGTH = struct.Struct("<Q")
# The longest message. The maps of the largest size take half of it.
MAX_BYTES = 2**30
# What an array may hold.
DTYPES = ("bool", "uint8", "uint16", "uint32", "int32", "int64", "float32", "float64")
# The key that says which type a table stands for; no parameter has such a name.
TYPE = "$type"


class MessageError(ValueError):
    """What came is no message."""


class Channel:
    """One end of a socket between two processes; one thread uses it."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected

    def send(self, value: Any, timeout_s: float | None = None) -> None:
        """Send a value of plain data, arrays, meshes, maps and views. Raises OSError, TimeoutError among them."""
        content = pack(value)
        self._socket.settimeout(timeout_s)
        self._socket.sendall(_LENGTH.pack(len(content)) + content)

    def receive(self, timeout_s: float | None = None) -> Any:
        """The next value; tuples come as lists.

        Raises TimeoutError unless all of it has come in time, EOFError when the other end is closed, OSError,
        MessageError for what is no message, and MeshError for a mesh that cannot be used.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        (length,) = _LENGTH.unpack(self._read(_LENGTH.size, deadline))
        if length > MAX_BYTES:
            raise MessageError(f"A message has at most {MAX_BYTES} bytes, got {length}.")
        return unpack(self._read(length, deadline))

    def wait(self, seconds: float) -> bool:
        """Whether the other end sent something, or was closed, within so many seconds; raises OSError."""
        self._socket.settimeout(seconds)
        try:
            self._socket.recv(1, socket.MSG_PEEK)
        except TimeoutError:
            return False
        return True

    def close(self) -> None:
        self._socket.close()

    def _read(self, size: int, deadline: float | None) -> bytearray:
        content = bytearray(size)
        left = memoryview(content)
        while left:
            self._socket.settimeout(None if deadline is None else max(deadline - time.monotonic(), 1e-3))
            count = self._socket.recv_into(left)
            if not count:
                raise EOFError
            left = left[count:]
        return content


def pack(value: Any) -> bytes:
    """A value as bytes: JSON, and after it the content of the arrays in their order."""
    arrays: list[bytes] = []
    text = json.dumps(value, default=partial(_table, arrays)).encode()
    return b"".join([_LENGTH.pack(len(text)), text, *arrays])


def unpack(content: bytes | bytearray) -> Any:
    """The value of some bytes; raises MessageError and MeshError."""
    try:
        (length,) = _LENGTH.unpack_from(content)
        text, arrays = content[_LENGTH.size : _LENGTH.size + length], io.BytesIO(content[_LENGTH.size + length :])
        value = json.loads(text, object_hook=partial(_value, arrays))
        if arrays.read(1):
            raise MessageError("This is no message: more came than its arrays have.")
        return value
    except (MessageError, MeshError):
        raise
    # Whatever else is wrong with bytes of which nothing is known.
    except Exception as error:
        raise MessageError(f"This is no message ({type(error).__name__}: {error}).") from None


def _table(arrays: list[bytes], value: Any) -> Any:
    """A table that stands for a value that is not plain data; the content of an array is added to `arrays`."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        arrays.append(value.tobytes())
        return {TYPE: "array", "dtype": value.dtype.name, "shape": value.shape}
    assert type(value).__name__ in _MAKE, type(value)
    return {TYPE: type(value).__name__} | {field.name: getattr(value, field.name) for field in fields(value)}


def _value(arrays: io.BytesIO, table: dict[str, Any]) -> Any:
    """The value that a table stands for; other tables as they are."""
    if TYPE not in table:
        return table
    kind = table.pop(TYPE)
    return _array(arrays, **table) if kind == "array" else _MAKE[kind](**table)


def _array(arrays: io.BytesIO, dtype: str, shape: list[int]) -> np.ndarray:
    size = math.prod(shape) * np.dtype(dtype).itemsize if dtype in DTYPES else -1
    if size < 0 or size > MAX_BYTES or min(shape, default=0) < 0:
        raise MessageError(f"This is no array: {dtype}, {shape}.")
    # The copy can be written to; NumPy refuses too few bytes.
    return np.frombuffer(arrays.read(size), dtype).reshape(shape).copy()


def _mesh(part_names: list[str], **arrays: Any) -> Mesh:
    return make_mesh(part_names=tuple(map(str, part_names)), **arrays)


_MAKE: dict[str, Callable[..., Any]] = {Mesh.__name__: _mesh, Maps.__name__: make_maps, View.__name__: View}
