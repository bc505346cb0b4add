"""What a stranger sends to be learned, written to a folder and checked before a program reads it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

from dipcg.app.given import check_given
from dipcg.app.sources import check_source

# The files of an upload in its folder.
SOURCE, GIVEN = "source", "given.toml"


async def receive(content: AsyncIterator[bytes], folder: Path, toml: int) -> None:
    """Write a body to a folder: its first `toml` bytes are a TOML file, and the others the source."""
    left = toml
    with (folder / GIVEN).open("wb") as given, (folder / SOURCE).open("wb") as source:
        async for chunk in content:
            source.write(chunk[left:])
            left -= given.write(chunk[:left])


def check_upload(folder: Path, file: str, blender: str) -> None:
    """Raise ValueError with a sentence for what may not be learned; see `check_source` and `check_given`."""
    check_source(folder / SOURCE, file, blender)
    if (folder / GIVEN).stat().st_size:
        check_given(folder / GIVEN, folder / SOURCE, file)
    else:
        (folder / GIVEN).unlink()
