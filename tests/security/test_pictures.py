"""Any picture takes at most 300 MB of the server's memory, and formats are those of a list."""

import contextlib
import io
import struct
import zlib

import pytest
from PIL import Image

from dipcg.app.client import ApiError, Client

MOST_MB = 300
SIDE = 8000


def png(side: int, bits: int = 8, colour: int = 6) -> bytes:
    """A PNG of one colour, with many pixels in few bytes."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    row = b"\0" + b"\x80" * (side * {0: 1, 2: 3, 6: 4}[colour] * bits // 8)
    packer = zlib.compressobj(1)
    rows = b"".join(packer.compress(row) for _ in range(side)) + packer.flush()
    header = struct.pack(">IIBBBBB", side, side, bits, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def ico(content: bytes) -> bytes:
    """An icon that holds a picture and says that it is small."""
    return struct.pack("<HHHBBBBHHII", 0, 1, 1, 64, 64, 0, 0, 1, 32, len(content), 22) + content


def saved(side: int, kind: str, mode: str = "RGB", **options: object) -> bytes:
    file = io.BytesIO()
    picture = Image.new(mode, (side, side), 128 if mode in "LP" else (128, 90, 60, 255)[: len(mode)])
    picture.save(file, kind, **options)
    return file.getvalue()


PICTURES = {
    "a PNG of 64 million pixels with transparency": lambda: png(SIDE),
    "a PNG of 64 million grey pixels of 16 bits": lambda: png(SIDE, 16, 0),
    "a PNG of 64 million pixels of 16 bits with transparency": lambda: png(SIDE, 16),
    "a PNG of 169 million pixels": lambda: png(13_000),
    "an icon that holds it": lambda: ico(png(13_000)),
    "a progressive JPEG of 64 million pixels": lambda: saved(SIDE, "JPEG", progressive=True, subsampling=0),
    "a progressive JPEG of 40 million pixels": lambda: saved(6320, "JPEG", progressive=True, subsampling=0),
    "a baseline JPEG of 64 million pixels": lambda: saved(SIDE, "JPEG"),
    "a WebP of 16 million pixels": lambda: saved(4000, "WEBP", method=0),
    "a WebP of 64 million pixels": lambda: saved(SIDE, "WEBP", method=0),
    "a GIF of 64 million pixels": lambda: saved(SIDE, "GIF", "P"),
    "a TIFF of 64 million pixels in one strip": lambda: saved(
        SIDE, "TIFF", compression="tiff_adobe_deflate", strip_size=2**31 - 1
    ),
    "a TIFF of 36 million pixels in one strip": lambda: saved(
        6000, "TIFF", compression="tiff_adobe_deflate", strip_size=2**31 - 1
    ),
    "an AVIF of 24 million pixels": lambda: saved(4898, "AVIF", speed=10, subsampling="4:4:4"),
}


@pytest.fixture(scope="module")
def at_first(process) -> float:
    """What the server uses before it has decoded anything large, since memory that was freed is used again."""
    Client(process.url).upload(saved(64, "PNG"))
    return process.memory("VmRSS")


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_takes_little_memory_or_is_refused(process, at_first, name):
    content, client = PICTURES[name](), Client(process.url)
    process.forget_peak()
    with contextlib.suppress(ApiError):
        client.upload(content)
    used = process.memory("VmHWM") - at_first
    assert used < MOST_MB, f"{name} takes {used:.0f} MB"


EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 64 64\n/showpage\n"


@pytest.mark.parametrize("content", [EPS, ico(png(64)), b"<svg/>", b"%PDF-1.7", b"P6 64 64 255 " + bytes(3 * 64 * 64)])
def test_other_formats_are_refused_whatever_they_are_called(process, content):
    with pytest.raises(ApiError, match="not a picture in a known format"):
        Client(process.url).upload(content)


def test_the_limit_of_pixels_is_told(process):
    with pytest.raises(ApiError, match="64 million are read"):
        Client(process.url).upload(png(9000))
