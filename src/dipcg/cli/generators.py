"""Commands about generators: generators, generators add."""

from __future__ import annotations

import json as jsons
import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from dipcg.cli.assets import Settings, parse_settings

NewFile = Annotated[Path | None, arg(aliases=["-o"], metavar="FILE")]
Ranges = Annotated[Settings, arg(metavar="NAME=LOW:HIGH")]


def generators(name: Positional[str] = "", /, *, json: bool = False) -> None:
    """List the generators, or the parameters of one.

    Args:
        name: a generator's name, or the path of a Python or TOML file
        json: print JSON
    """
    from dipcg.cli import listing

    print(listing.parameters(name, json) if name else listing.generators(json))


def generators_add(
    file: Positional[Path], /, *, object: str = "", range: Ranges = (), output: NewFile = None, json: bool = False
) -> None:
    """Make a generator of a Blender file: its Geometry Nodes inputs become parameters in a TOML file to edit.

    Args:
        file: a Blender file, ending in .blend
        object: the object with the modifier, where several have one
        range: lowest and highest value of an input, as name=low:high; narrows limits, or sets them where there are none
        output: TOML file to write; beside the Blender file when left out
        json: print what was made as JSON
    """
    from dipcg.blender.importer import import_blend

    made = import_blend(file, object, parse_settings(range), output, input if sys.stdin.isatty() else None)
    if json:
        print(jsons.dumps({"output": str(made.path), "parameters": made.parameters, "left_out": made.left_out}))
        return
    print(f"Wrote {made.path}, {len(made.parameters)} parameters: {', '.join(made.parameters)}.")
    for name, why in made.left_out.items():
        print(f"Left out {name}: {why}.")
    print(f"Try: dipcg sample {made.path} -o {made.path.stem}.glb")
