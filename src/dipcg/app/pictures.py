"""The pictures of visitors: decoded once when they come, small from then on, and never a file."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import IO

import numpy as np
from PIL import Image

from dipcg.app.limits import KEPT_S, PICTURES_BYTES, PICTURES_OF_ONE
from dipcg.app.store import Store
from dipcg.images import RGBA, Cutout, read_image
from dipcg.images.cutout import Background


@dataclass(frozen=True)
class Kept:
    """A picture as PNG; `background` says what a cut-out was cut from, `notes` what its sender should know."""

    png: bytes
    width: int
    height: int
    background: Background | None = None
    notes: tuple[str, ...] = ()

    def open(self) -> RGBA | Cutout:
        """The picture, or the cut-out."""
        image = np.array(Image.open(io.BytesIO(self.png), formats=["PNG"]).convert("RGBA"))
        return Cutout(image, self.background, self.notes) if self.background else image


class Pictures:
    """The pictures of all visitors, by unguessable id."""

    def __init__(self) -> None:
        self._kept: Store[Kept] = Store(KEPT_S, PICTURES_BYTES, PICTURES_OF_ONE)

    def read(self, file: IO[bytes], owner: str) -> tuple[str, Kept]:
        """Decode an upload and keep it; raises images.ImageError with a sentence."""
        image, notes = read_image(file.read())
        return self._keep(_as_kept(image, None, notes), owner)

    def add(self, cutout: Cutout, owner: str) -> tuple[str, Kept]:
        """Keep a cut-out; returns its id too."""
        return self._keep(_as_kept(cutout.image, cutout.background, cutout.notes), owner)

    def _keep(self, kept: Kept, owner: str) -> tuple[str, Kept]:
        return self._kept.add(kept, len(kept.png), owner), kept

    def get(self, name: str) -> Kept:
        """The picture of an id; raises LookupError with a sentence."""
        try:
            return self._kept.get(name)
        except KeyError:
            raise LookupError("There is no such picture here, or its time is over; send it again.") from None

    def remove(self, name: str) -> None:
        """Forget a picture."""
        self._kept.remove(name)

    def sweep(self) -> None:
        self._kept.sweep()


def _as_kept(image: RGBA, background: Background | None, notes: tuple[str, ...]) -> Kept:
    height, width = image.shape[:2]
    return Kept(png(image), width, height, background, notes)


def png(image: RGBA) -> bytes:
    """A picture as PNG, compressed quickly."""
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(file, "PNG", compress_level=1)
    return file.getvalue()


def data_url(image: RGBA) -> str:
    """A picture as the address that holds it."""
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(file, "WEBP", quality=85)
    return "data:image/webp;base64," + base64.b64encode(file.getvalue()).decode()
