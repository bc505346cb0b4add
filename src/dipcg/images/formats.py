"""Which files are read as pictures: an allow list, and a limit of pixels that is checked before any is decoded.

Pillow tries no other format than those listed, so that no file can start Ghostscript, or a rarely used decoder. A file
is recognised by its first bytes; its name and what the sender calls it do not count.
"""

from __future__ import annotations

import io
import warnings

from PIL import Image, UnidentifiedImageError

FORMATS = ("PNG", "JPEG", "WEBP", "GIF", "BMP", "TIFF", "AVIF", "HEIF")
# The endings of such files.
SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".gif", ".bmp", ".tif", ".tiff", ".avif", ".heic", ".heif")

MAX_PIXELS = 64_000_000
# Decoders of these hold a picture several times while they unpack it.
MAX_PIXELS_OF = {"WEBP": 16_000_000, "TIFF": 36_000_000, "AVIF": 24_000_000, "HEIF": 50_000_000}
# All of a progressive JPEG is held until its last pass.
MAX_PIXELS_PROGRESSIVE = 40_000_000
MIN_SIDE = 16


class ImageError(ValueError):
    """A picture that cannot be used; the message says why and what to do."""


def open_picture(data: bytes, name: str) -> Image.Image:
    """Open a file in memory, of which only the header is read, and check its size.

    Raises ImageError for another format and for too many pixels or too few; what Pillow raises for damaged files passes
    through. `name` begins the messages.
    """
    if not data:
        raise ImageError(f"{name} is empty (0 bytes).")
    try:
        with warnings.catch_warnings():
            # The limit of this file is lower and has a message of its own. Pillow also warns of formats it cannot read.
            warnings.simplefilter("ignore")
            picture = Image.open(io.BytesIO(data), formats=_readable())
    except UnidentifiedImageError:
        raise ImageError(_unreadable(data, name)) from None
    check_size(picture, name)
    return picture


def check_size(picture: Image.Image, name: str) -> None:
    """Raise ImageError for too many pixels or too few."""
    (width, height), limit = picture.size, MAX_PIXELS_OF.get(picture.format or "", MAX_PIXELS)
    if "progressive" in picture.info:
        limit = MAX_PIXELS_PROGRESSIVE
    if width * height > limit:
        raise ImageError(f"{name} has {width} × {height} pixels; at most {limit / 1e6:.0f} million are read.")
    if min(width, height) < MIN_SIDE:
        raise ImageError(f"{name} has {width} × {height} pixels; at least {MIN_SIDE} × {MIN_SIDE} are needed.")


def _readable() -> list[str]:
    """The formats that this installation reads; HEIF only where pillow-heif is installed."""
    try:
        from pillow_heif import register_heif_opener
    except ImportError:
        return [name for name in FORMATS if name != "HEIF"]
    register_heif_opener()
    return list(FORMATS)


def _unreadable(data: bytes, name: str) -> str:
    """Why a file is no picture that can be read, and what helps."""
    # ISO 14496-12: the file type, after its length, begins the file and names a brand.
    brand = data[8:12] if data[4:8] == b"ftyp" else b""
    if brand[:3] in (b"avi", b"av0"):
        return f"{name} is an AVIF picture, which this Pillow cannot read; install Pillow 11.3 or later."
    if brand[:2] in (b"he", b"mi", b"ms"):
        return f"{name} is a HEIC picture; install pillow-heif (pip install 'dipcg[heic]'), or save it as JPEG."
    if data[:4] in (b"II*\0", b"MM\0*"):
        return f"{name} is a TIFF of an unusual kind, or damaged; save it as PNG."
    return f"{name} is not a picture in a known format; use PNG, JPEG, WebP, GIF, BMP, TIFF, AVIF or HEIC."
