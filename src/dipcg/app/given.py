"""The TOML file that a stranger sends before a Blender file: what it may say.

It names parameters of inputs in that Blender file and their ranges. It names no program, no other file and no code.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, ValidationError

from dipcg.app.limits import MOST_TOML_LINE
from dipcg.app.models import Request
from dipcg.blender.declaration import digest

# What the TOML files of other sources have, and what other plugins are declared by.
CODE = ("program", "scad", "entry", "script")


def _identifier(name: str) -> str:
    if not name.isidentifier():
        raise ValueError(f"a parameter's name is made of letters, digits and _, got {name!r}")
    return name


def _mirrored(name: str) -> str:
    _identifier(name.removeprefix("-"))
    return name


Name = Annotated[str, Field(max_length=100), AfterValidator(_identifier)]
Mirrored = Annotated[str, Field(max_length=101), AfterValidator(_mirrored)]
Short = Annotated[str, Field(max_length=200)]
Long = Annotated[str, Field(max_length=1500)]
Number = Annotated[float, Field(ge=-1e9, le=1e9, allow_inf_nan=False)]
Whole = Annotated[int, Field(ge=-(10**9), le=10**9)]
Value = bool | Whole | Number | Short
Conditions = dict[Name, Annotated[list[Value], Field(max_length=100)]]


class Given(Request):
    """A table of the file; types are not converted."""

    model_config = ConfigDict(extra="forbid", strict=True)


class GivenParameter(Given):
    """A parameter, as `blender.declaration` has it."""

    input: Short
    component: Literal["", "x", "y", "z"] = ""
    kind: Literal["real", "integer", "boolean", "menu"]
    low: Number | None = None
    high: Number | None = None
    options: Annotated[list[Short], Field(max_length=100, default_factory=list)]
    unit: Short = ""
    group: Short = ""
    doc: Long = ""
    why: Long = ""
    default: Value | None = None
    when: Annotated[Conditions, Field(max_length=100, default_factory=dict)]


class GivenFile(Given):
    """The whole file."""

    doc: Long = ""
    blend: Short
    object: Short
    modifier: Short = ""
    group: Annotated[list[Short], Field(max_length=20, default_factory=list)]
    sha256: Short
    mirrors: Annotated[dict[Name, Mirrored], Field(max_length=500, default_factory=dict)]
    parameters: Annotated[dict[Name, GivenParameter], Field(min_length=1, max_length=500)]


def check_given(given: Path, source: Path, file: str) -> None:
    """Raise ValueError with a sentence for a TOML file that may not be used with a Blender file of this name."""
    if not file.lower().endswith(".blend"):
        raise ValueError(f"A TOML file is taken with a Blender file alone, got it with {file}.")
    top = _read(given.read_bytes())
    _check_safe(top, Path(file).name)
    try:
        checked = GivenFile.model_validate(top)
    except ValidationError as error:
        raise ValueError(f"The TOML file cannot be used: {_first(error)}.") from None
    _check_mirrors(checked)
    if checked.sha256 != digest(source):
        raise ValueError(
            f"The TOML file was written for another version of {file}, whose inputs may be others. Write a new one "
            f'with `dipcg generators add`, or if they are the same, put sha256 = "{digest(source)}" there.'
        )


def _read(content: bytes) -> dict[str, Any]:
    if max(map(len, content.split(b"\n"))) > MOST_TOML_LINE:
        raise ValueError(f"A line of the TOML file is longer than {MOST_TOML_LINE} bytes; make it shorter.")
    try:
        return tomllib.loads(content.decode())
    except RecursionError:
        raise ValueError("The TOML file is nested too deeply.") from None
    except ValueError as error:
        raise ValueError(f"The TOML file cannot be read: {error}.") from None


def _check_safe(top: dict[str, Any], file: str) -> None:
    """Raise ValueError for what would run something, or lead out of the upload."""
    for key in CODE:
        if key in top:
            raise ValueError(
                f"The TOML file names code with `{key}`, which is not run here; send one for a Blender file."
            )
    if "blender" in top:
        raise ValueError("The TOML file names a program with `blender`; delete this line, the server uses its own.")
    if top.get("blend") != file:
        raise ValueError(f'The TOML file must name the file that it is sent with, as `blend = "{file}"`.')


def _check_mirrors(given: GivenFile) -> None:
    names = {name.removeprefix("-") for pair in given.mirrors.items() for name in pair}
    if unknown := sorted(names - given.parameters.keys()):
        raise ValueError(f"`mirrors` of the TOML file has {unknown[0]!r}, which is no parameter of it.")


def _first(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in first["loc"] if not str(part).startswith("function-"))
    return f"{where}: {first['msg'].removeprefix('Value error, ')}"
