"""What the file of a stranger's generator may be, before a program reads it."""

from __future__ import annotations

import re
from pathlib import Path

from dipcg.app.limits import MOST_SCAD_BYTES
from dipcg.importing.header import saved_by
from dipcg.importing.program import ours

ENDINGS = (".blend", ".scad", ".py")
NO_CODE = (
    "A Python file would run here with all rights of the server, so none is taken. Where only people that you trust "
    "reach the server, start it with `dipcg serve --learn FOLDER --allow-code FOLDER`."
)
# Strings and comments of OpenSCAD, which are passed over, and the words that read other files of the machine. It reads
# bytes, as OpenSCAD does, for which only \n ends a comment; a word also begins behind a number, as in `1.5include`; and
# nothing is tried twice, because a search that goes back takes hours for a megabyte and stops the whole server.
OPENSCAD = re.compile(
    rb'"(?:[^"\\]|\\.)*+(?P<text>"|\\?\Z)|//[^\n]*|/\*(?:[^*]|\*(?!/))*+(?P<comment>\*/|\Z)'
    rb"|(?<![A-Za-z_])(?P<word>include|use|import\w*|surface|dxf_\w+)\b",
    re.DOTALL,
)


def check_name(file: str, takes_code: bool) -> None:
    """Raise ValueError with a sentence for a file that is not of a kind that is learned here."""
    ending = Path(file).suffix.lower()
    if ending not in ENDINGS:
        raise ValueError(f"Give a Blender file (.blend), an OpenSCAD file (.scad) or a Python file, got {file!r}.")
    if ending == ".py" and not takes_code:
        raise ValueError(NO_CODE)


def check_source(path: Path, file: str, blender: str = "") -> None:
    """Raise ValueError with a sentence for no Blender file or one that is too new, or OpenSCAD that reads other files.

    `blender` is another Blender that the server has for newer files.
    """
    if file.lower().endswith(".blend"):
        _check_blend(path, file, blender)
    if file.lower().endswith(".scad"):
        _check_alone(path.read_bytes(), file)


def _check_blend(path: Path, file: str, blender: str) -> None:
    try:
        version = saved_by(path)
    except ValueError:
        raise ValueError(f"{file} is not a Blender file; give one that Blender saved.") from None
    # Blender reads files of its own major version, with what it does not know left out, and ours may not be there.
    if not blender and version[0] > ours()[0] > 0:
        named, own = (f"{major}.{minor}" for major, minor in (version, ours()))
        raise ValueError(
            f"{file} was saved by Blender {named}, and this server has Blender {own}. Start it with `dipcg serve "
            f"--learn FOLDER --blender PROGRAM`, the program of Blender {named} or later."
        )


def _check_alone(content: bytes, file: str) -> None:
    if len(content) > MOST_SCAD_BYTES:
        raise ValueError(f"{file} has {len(content):,} bytes; an OpenSCAD file may have {MOST_SCAD_BYTES:,} here.")
    for match in OPENSCAD.finditer(content):
        # What OpenSCAD gets of us behind the file, as text, would close it and be taken for commands.
        if not match[match.lastgroup or 0] or match["text"] == b"\\":
            raise ValueError(f"{file} ends within a {match.lastgroup}; close it.")
        if match["word"]:
            raise ValueError(
                f"{file} uses `{match['word'].decode()}`, which reads other files. Here it must stand alone; put all "
                "of it into one file."
            )
