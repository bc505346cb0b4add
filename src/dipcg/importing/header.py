"""The version of Blender that saved a file, from the file's first bytes."""

from __future__ import annotations

import gzip
import re
import zlib
from pathlib import Path

import zstandard

# Enough for the header of every version.
LENGTH = 24
# The first bytes of a compressed file: by Zstandard since Blender 3.0, by gzip before.
ZSTANDARD, GZIP = b"\x28\xb5\x2f\xfd", b"\x1f\x8b"
# BLENDER-v402 since 1994, with - or _ for the size of a pointer and v or V for the order of bytes; BLENDER17-01v0501
# since Blender 5.0, with the size of the header and the version of the format.
HEADER = re.compile(rb"BLENDER(?:[-_][vV](\d)(\d\d)|\d\d-\d\d[vV](\d\d)(\d\d))")


def saved_by(path: Path) -> tuple[int, int]:
    """The version of Blender that saved a file, such as (4, 2); raises ValueError with a sentence, and OSError."""
    try:
        found = HEADER.match(_start(path))
    except (zstandard.ZstdError, zlib.error, EOFError, gzip.BadGzipFile):
        found = None
    if not found:
        raise ValueError(f"{path} is not a Blender file; give one that Blender saved, ending in .blend.")
    major, minor = (int(digits) for digits in found.groups() if digits)
    return major, minor


def _start(path: Path) -> bytes:
    with path.open("rb") as file:
        start = file.read(LENGTH)
        file.seek(0)
        if start.startswith(ZSTANDARD):
            return zstandard.ZstdDecompressor().stream_reader(file).read(LENGTH)
        if start.startswith(GZIP):
            return gzip.GzipFile(fileobj=file).read(LENGTH)
        return start
