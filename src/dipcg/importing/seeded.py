"""A generator from a seeded program: some runs are recorded, and the draws that change the mesh become parameters."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dipcg.generators import load_generator
from dipcg.importing.effects import UNTRIED, Effects, conditions
from dipcg.importing.imported import Imported, Row, grouped, listed
from dipcg.importing.search import find_effects
from dipcg.importing.survey import TIMEOUT_S, Runner, space_of, survey
from dipcg.registry import allow_code
from dipcg.space import Choice, Parameter, ParameterSpace
from dipcg.tracing.declaration import identity, write_program
from dipcg.tracing.parameters import Entry
from dipcg.tracing.programs import full_name, only_function
from dipcg.tracing.sites import snake

# A model with more parameters than this learns too slowly; those that move the surface least are left out.
MAX_PARAMETERS = 48

Top = dict[str, Any]


def import_program(
    source: str,
    function: str = "",
    arguments: Mapping[str, Any] | None = None,
    output: Path | None = None,
    seconds: float = 600.0,
    seed: int = 0,
) -> Imported:
    """Write the TOML file that makes a generator of `module:callable`, or of a function in a Python file.

    It takes a seed or a random number generator. Looking at it takes at most about `seconds`. Raises
    ValueError with a sentence for a program that cannot be recorded, and OSError when the file cannot be written.
    """
    program = full_name(source if ":" in source else f"{source}:{function or only_function(Path(source))}")
    path = output or _output(program)
    if path.exists():
        raise ValueError(f"{path} is there already; delete it, or choose another with -o.")
    until = time.monotonic() + seconds
    top: Top = {"doc": _doc(program), "program": program, "seed": seed, "arguments": dict(arguments or {})}
    with Runner(program, seed, top["arguments"]) as runner:
        entries, left_out = survey(runner, until - 0.5 * seconds)
        if not entries:
            raise ValueError(f"{program} has no draw that can be a parameter ({listed(left_out, 'it draws nothing')}).")
        runner.check_repeats(entries)
        effects, entries, left_out = _with_effects(runner, entries, left_out, until)
    if not entries:
        raise ValueError(f"{program} has no draw that was seen to change the mesh ({listed(left_out)}).")
    path.write_text(_text(top, entries, path), encoding="utf-8")
    allow_code(path)
    rows = [_row(name, entry, load_generator(str(path)).space[name]) for name, entry in entries.items()]
    return Imported(path, rows, grouped(left_out), effects.notes())


def _with_effects(
    runner: Runner, entries: dict[str, Entry], left_out: dict[str, str], until: float
) -> tuple[Effects, dict[str, Entry], dict[str, str]]:
    """Leave out what does not change the mesh, and say under which options the rest does."""
    space = space_of(entries)
    seconds = max(until - time.monotonic(), TIMEOUT_S)
    effects = find_effects(space, lambda many: runner.meshes(entries, many), np.random.default_rng(0), seconds)
    names = _largest(space, effects)
    for name in space.names:
        if name not in names:
            left_out[name] = _why(effects.sizes.get(name))
    kept = {name: entries[name] for name in space.names if name in names}
    when = conditions(space, list(kept), effects)
    return effects, {name: entry | {"when": when[name]} for name, entry in kept.items()}, left_out


def _why(size: float | None) -> str:
    if size is None:
        return UNTRIED
    return "moves the surface less than the others" if size else "no effect on the mesh"


def _largest(space: ParameterSpace, effects: Effects) -> set[str]:
    """The parameters that move the surface most, with all choices that others depend on."""
    ordered = sorted(space.names, key=lambda name: -effects.sizes.get(name, 0.0))
    names = {name for name in ordered[:MAX_PARAMETERS] if effects.sizes.get(name)}
    return names | {other for name in names for other, _ in space.conditions(name)}


def _text(top: Top, entries: Mapping[str, Entry], path: Path) -> str:
    place, _, function = top["program"].rpartition(":")
    if place.endswith(".py"):
        place = Path(os.path.relpath(Path(place).resolve(), path.parent.resolve())).as_posix()
    written = top | {"program": f"{place}:{function}"} | identity(top["program"])
    return write_program(written, entries, path)


def _row(name: str, entry: Entry, parameter: Parameter) -> Row:
    value = str(parameter.inactive) if isinstance(parameter, Choice) else f"{parameter.inactive:.4g}"
    allowed = (
        ", ".join(map(str, parameter.options))
        if isinstance(parameter, Choice)
        else f"{parameter.low:.4g} to {parameter.high:.4g} {parameter.unit}"
    )
    return Row(name, value, allowed, entry["doc"])


def _doc(program: str) -> str:
    place, _, name = program.rpartition(":")
    return f"{name} of {Path(place).name}, with its random draws as parameters."


def _output(program: str) -> Path:
    place, _, name = program.rpartition(":")
    return Path(place).with_suffix(".toml") if place.endswith(".py") else Path(f"{snake(name)}.toml")
