"""Commands about generators: generators, generators add."""

from __future__ import annotations

import json as jsons
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from dipcg.cli import listing
from dipcg.cli.assets import Settings, parse_settings

if TYPE_CHECKING:
    from dipcg.importing.imported import Imported

NewFile = Annotated[Path | None, arg(aliases=["-o"], metavar="FILE")]
Ranges = Annotated[Settings, arg(metavar="NAME=LOW:HIGH")]


def generators(name: Positional[str] = "", /, *, json: bool = False) -> None:
    """List the generators, or the parameters of one.

    Args:
        name: a generator's name, or the path of a Python or TOML file
        json: print JSON
    """
    print(listing.parameters(name, json) if name else listing.generators(json))


def generators_add(
    source: Positional[str], /, *, object: str = "", range: Ranges = (), output: NewFile = None, json: bool = False
) -> None:
    """Make a generator of what others made: a TOML file with its parameters, which you can edit.

    Args:
        source: a Blender file, ending in .blend: the inputs of its Geometry Nodes become parameters
        object: the object with the modifier, where several have one
        range: lowest and highest value of an input, as name=low:high; narrows limits, or sets them where there are none
        output: TOML file to write; beside the source when left out
        json: print what was made as JSON
    """
    if source.endswith(".blend"):
        from dipcg.importing.blend import import_blend

        made = import_blend(Path(source), object, parse_settings(range), output, input if sys.stdin.isatty() else None)
    else:
        raise ValueError(f"{source} is no source of a generator; give a Blender file, ending in .blend.")
    print(jsons.dumps(_as_json(made)) if json else listing.imported(made))


def _as_json(made: Imported) -> dict[str, Any]:
    rows = {row.name: row._asdict() for row in made.rows}
    return {"output": str(made.path), "parameters": rows, "left_out": made.left_out, "notes": made.notes}
