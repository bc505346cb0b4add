"""Messages of worker processes: what goes in comes out, and what a stranger's process sends is data that is checked."""

import contextlib
import json
import pickle
import socket
import struct
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dipcg.camera import View
from dipcg.mesh import Mesh, MeshError
from dipcg.workers.messages import MAX_BYTES, TYPE, Channel, MessageError, pack, unpack

PLAIN = st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | st.text()
TRIANGLE = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)


@pytest.fixture
def ends():
    """Two ends of a socket: a channel, and what is written to by hand."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield Channel(ours), theirs


@pytest.mark.slow
@given(st.recursive(PLAIN, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abc"), inner)))
def test_plain_data_comes_back(value):
    assert unpack(pack(value)) == value


@pytest.mark.parametrize("dtype", ["bool", "uint8", "int64", "float32", "float64"])
@pytest.mark.parametrize("shape", [(), (0, 3), (4,), (2, 3, 4)])
def test_arrays_come_back_and_can_be_written_to(dtype, shape):
    array = np.arange(np.prod(shape, dtype=int)).astype(dtype).reshape(shape)
    back = unpack(pack(array))
    np.testing.assert_array_equal(back, array)
    assert (back.dtype, back.flags.writeable) == (array.dtype, True)


def test_assets_come_back(textured):
    for value in (textured.mesh, textured.maps, View(10.0, 20.0)):
        back = unpack(pack(("done", value)))[1]
        assert type(back) is type(value)
        for name in type(value).__dataclass_fields__:
            np.testing.assert_array_equal(getattr(back, name), getattr(value, name))


class Evil:
    def __reduce__(self):
        return print, ("this ran",)


def message(value: object, arrays: bytes = b"") -> bytes:
    text = json.dumps(value).encode()
    return struct.pack("<Q", len(text)) + text + arrays


def array(**changes: object) -> bytes:
    return message({TYPE: "array", "dtype": "float32", "shape": [2]} | changes, b"\0" * 8)


BAD = {
    "a pickle": pickle.dumps(Evil()),
    "a pickle inside": message({TYPE: "array", "dtype": "object", "shape": [1]}, pickle.dumps(Evil())),
    "too few bytes": array(shape=[3]),
    "too many bytes": array(shape=[1]),
    "an enormous shape": array(shape=[2**40, 2**40]),
    "a negative shape": array(shape=[-1, -2]),
    "no shape": array(shape="ab"),
    "an unknown type": message({TYPE: "Popen"}),
    "no type": message({TYPE: ["array"]}),
    "other fields": message({TYPE: "Mesh", "file": "/etc/passwd"}),
    "deep nesting": struct.pack("<Q", 10**6) + b"[" * 10**6,
    "half": pack((1, 2, 3))[:-1],
    "more": pack(1) + b"\0",
    "nothing": b"",
}


@pytest.mark.parametrize("content", BAD.values(), ids=list(BAD))
def test_what_is_no_message_is_refused_and_runs_nothing(content, capfd):
    with pytest.raises(MessageError):
        unpack(content)
    assert "this ran" not in capfd.readouterr().out


@given(st.binary(max_size=200))
def test_any_bytes_are_a_value_or_a_message_error(content):
    with contextlib.suppress(MessageError, MeshError):
        unpack(content)


@pytest.mark.parametrize(
    "changes",
    [
        {"faces": np.array([[0, 1, 3]], np.int32)},
        {"faces": np.array([[0, 1, -1]], np.int32)},
        {"vertices": np.full((3, 3), np.nan, np.float32)},
        {"parts": np.array([7], np.uint8)},
        {"parts": np.array([0, 0], np.uint8)},
        {"vertices": np.zeros((0, 3), np.float32)},
    ],
)
def test_a_mesh_that_names_what_is_not_there_is_refused(changes):
    fields = {"vertices": TRIANGLE[0], "faces": TRIANGLE[1], "parts": np.zeros(1, np.uint8), "part_names": ("body",)}
    assert isinstance(unpack(pack({TYPE: "Mesh"} | fields)), Mesh)
    with pytest.raises(MeshError):
        unpack(pack({TYPE: "Mesh"} | fields | changes))


def test_half_a_message_is_waited_for_until_the_time_is_up(ends):
    channel, theirs = ends
    theirs.sendall(struct.pack("<Q", 1000) + b"half")
    started = time.monotonic()
    with pytest.raises(TimeoutError):
        channel.receive(0.2)
    assert time.monotonic() - started < 5


def test_a_message_in_drops_does_not_get_more_time(ends):
    channel, theirs = ends
    stop = threading.Event()

    def drip() -> None:
        theirs.sendall(struct.pack("<Q", 10_000))
        while not stop.wait(0.02):
            theirs.sendall(b"\0")

    thread = threading.Thread(target=drip)
    thread.start()
    started = time.monotonic()
    with pytest.raises(TimeoutError):
        channel.receive(0.3)
    stop.set()
    thread.join()
    assert time.monotonic() - started < 5


def test_a_length_beyond_the_limit_takes_no_memory(ends):
    channel, theirs = ends
    theirs.sendall(struct.pack("<Q", MAX_BYTES + 1))
    with pytest.raises(MessageError, match="at most"):
        channel.receive(1.0)


def test_the_end_of_the_other_side_is_noticed(ends):
    channel, theirs = ends
    theirs.sendall(b"\0\0")
    theirs.close()
    with pytest.raises(EOFError):
        channel.receive(1.0)
