"""Commands about generators: generators, generators add."""

from __future__ import annotations

import json as jsons
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, UseAppendAction, arg

from dipcg.cli import listing
from dipcg.cli.assets import Settings, parse_settings

if TYPE_CHECKING:
    from dipcg.importing.imported import Imported

NewFile = Annotated[Path | None, arg(aliases=["-o"], metavar="FILE")]
Names = Annotated[tuple[tuple[str, ...], ...], UseAppendAction, arg(metavar="NAME")]
Ranges = Annotated[Settings, arg(metavar="NAME=LOW:HIGH")]


def generators(name: Positional[str] = "", /, *, json: bool = False) -> None:
    """List the generators, or the parameters of one.

    Args:
        name: a generator's name, or the path of a Python or TOML file
        json: print JSON
    """
    print(listing.parameters(name, json) if name else listing.generators(json))


def generators_add(
    source: Positional[str],
    /,
    *,
    object: str = "",
    modifier: str = "",
    range: Ranges = (),
    hold: Names = (),
    ask: bool = False,
    blender: str = "",
    function: str = "",
    set: Settings = (),
    seconds: float = 600.0,
    output: NewFile = None,
    json: bool = False,
) -> None:
    """Make a generator of what others made: a TOML file with its parameters, which you can edit.

    Args:
        source: a Blender file, ending in .blend: the inputs of its Geometry Nodes become parameters; an OpenSCAD
            file, ending in .scad: what its Customizer shows; or a program with a seed, as module:function,
            infinigen:LampFactory, or a Python file: its random draws
        object: the object with the modifier, where several have one
        modifier: the modifier, where the object has several; the first with inputs when left out
        range: lowest and highest value of an input, as name=low:high; narrows limits, or sets them where there are none
        hold: inputs that stay as they are in the file
        ask: ask for the range of each input without limits; otherwise one is proposed and tried
        blender: another Blender to use, or a Python that has bpy; the TOML file remembers it
        function: the function in a Python file that takes a seed or a random number generator
        set: an argument of a program, as name=value
        seconds: about how long the source may be tried
        output: TOML file to write; beside the source when left out
        json: print what was made as JSON
    """
    if source.endswith(".blend"):
        from dipcg.cli.terminal import counter
        from dipcg.importing.blend import Options, import_blend

        names = tuple(chain.from_iterable(hold))
        options = Options(object, modifier, blender, parse_settings(range), names, input if ask else None)
        with counter("builds") as update:
            made = import_blend(Path(source), options, output, update, seconds)
    elif source.endswith(".scad"):
        from dipcg.importing.openscad import import_scad

        made = import_scad(Path(source), output, seconds)
    elif source.endswith(".py") or ":" in source:
        from dipcg.importing.seeded import import_program

        made = import_program(source, function, _arguments(set), output, seconds)
    else:
        raise ValueError(
            f"{source} is no source of a generator; give a .blend or .scad file, or a program as module:function "
            "or a Python file."
        )
    print(jsons.dumps(_as_json(made)) if json else listing.imported(made))


def _arguments(settings: Settings) -> dict[str, Any]:
    """Arguments of a program; numbers, true and false are read as such, all else is text."""
    return {name: _value(text) for name, text in parse_settings(settings).items()}


def _value(text: str) -> Any:
    try:
        return jsons.loads(text)
    except ValueError:
        return text


def generators_check(name: Positional[str], /) -> None:
    """Build a generator many times, and say what must be mended before it can be learned.

    Args:
        name: a generator's name, or the path of a Python or TOML file
    """
    from dipcg.cli.terminal import counter
    from dipcg.importing.contracts import check

    with counter("builds") as update:
        findings = list(check(name, update))
    for finding in findings:
        print(f"{'Hint' if finding.is_hint else 'Mend'}: {finding.text}")
    if any(not finding.is_hint for finding in findings):
        raise SystemExit(1)
    print(f"{name} keeps the contracts of a generator.")


def _as_json(made: Imported) -> dict[str, Any]:
    rows = {row.name: row._asdict() for row in made.rows}
    return {"output": str(made.path), "parameters": rows, "left_out": made.left_out, "notes": made.notes}
