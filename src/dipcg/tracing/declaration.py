"""The TOML file that makes a generator of a seeded program: `dipcg generators add` writes it, and people edit it."""

from __future__ import annotations

import hashlib
import math
import tomllib
from collections.abc import Mapping
from functools import partial
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from dipcg.blender.declaration import check_keys, parameter_of, write_declaration
from dipcg.mesh import Mesh
from dipcg.registry import check_allowed
from dipcg.space import Choice, ParameterSpace, Params, Value
from dipcg.tracing.distributions import Setting

TOP = ("doc", "program", "seed", "arguments", "version", "sha256", "mirrors", "parameters")
KEYS = (
    "draw", "kind", "low", "high", "options", "positions", "shares", "as", "unit", "group", "doc", "default", "when",
)  # fmt: skip
FORMS = ("value", "log", "share")
# Infinigen leaves something in Blender with each build, which slows it down.
RECYCLE_AFTER = 200
HEADER = """\
# A generator over a seeded program, written by `dipcg generators add`: its random draws are the parameters. Edit it:
# - names, ranges, units and docs; delete a parameter, and its draw keeps the value that the seed gives it;
# - `draw` says which draw it is: file, line, a hash of the calls that lead there, its number, and its component;
# - `as = "share"` is a share of a range that depends on other draws, `as = "log"` a draw whose exponential is used;
# - `when = {{ shade = ["cone", "bell"] }}` for a parameter that changes nothing under other options.
# Loading this file runs the program, so use only files that you trust.
# Use it: dipcg sample {path} -o {stem}.glb
"""


def read_program(path: Path) -> SimpleNamespace:
    """The names that a Python file of a generator defines (`space`, `build`, …), from a TOML file over a program.

    Raises LookupError when the file is not there, CodeError when nobody has allowed its program to run, and ValueError
    with a sentence when it cannot be used.
    """
    if not path.is_file():
        raise LookupError(f"There is no file {path} (looked for in {Path.cwd()}).")
    check_allowed(path)
    try:
        return declared(tomllib.loads(path.read_text(encoding="utf-8")), path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_program(top: Mapping[str, Any], parameters: Mapping[str, Mapping[str, Any]], path: Path) -> str:
    """The TOML text of a declaration over a program."""
    return write_declaration(top, parameters, path, HEADER, KEYS)


def declared(top: dict[str, Any], path: Path) -> SimpleNamespace:
    """What `read_program` returns, from the content of the file; raises ValueError with a sentence."""
    check_keys(top, TOP, ("program", "parameters"), "the file")
    entries = top["parameters"]
    for name, entry in entries.items():
        check_keys(entry, KEYS, ("draw", "kind"), name)
        if entry.get("as", "value") not in FORMS:
            raise ValueError(f"{name}: `as` is one of {', '.join(FORMS)}, got {entry['as']!r}.")
    space = ParameterSpace(*(parameter_of(name, entry) for name, entry in entries.items()))
    for p in space:
        _check_draws(p.name, entries[p.name], space)
    program = _unchanged(top, path)
    run = (program, top.get("seed", 0), top.get("arguments", {}))
    return SimpleNamespace(
        __doc__=top.get("doc", f"The random draws of {program}."),
        space=space,
        build=partial(_build, *run, space, entries),
        prepare=partial(_prepare, program),
        mirrors=top.get("mirrors"),
        needs=("infinigen", "bpy") if program.startswith("infinigen") else (),
        recycle_after=RECYCLE_AFTER,
    )


def settings(space: ParameterSpace, entries: Mapping[str, Mapping[str, Any]], params: Params) -> dict[str, Setting]:
    """The values of draws by their address, from parameters in natural units."""
    active = (name for name in space.names if space.is_active(name, params))
    return {entries[name]["draw"]: _setting(space, name, entries[name], params[name]) for name in active}


def identity(program: str) -> dict[str, str]:
    """What tells whether a program has changed: the hash of a file, or the version of the package."""
    place = program.rpartition(":")[0]
    if place.endswith(".py"):
        return {"sha256": hashlib.sha256(Path(place).read_bytes()).hexdigest()}
    package = place.partition(".")[0]
    try:
        return {"version": version((packages_distributions().get(package) or [package])[0])}
    except PackageNotFoundError:
        return {}


def _setting(space: ParameterSpace, name: str, entry: Mapping[str, Any], value: Value) -> Setting:
    p = space[name]
    if isinstance(p, Choice):
        at = p.index(value)
        if "shares" in entry:
            return "share", float(entry["shares"][at])
        return ("position", float(entry["positions"][at])) if "positions" in entry else ("value", float(value))
    how = entry.get("as", "value")
    number = float(value)
    if how == "log":
        return "value", math.log(number)
    return how, number


def _check_draws(name: str, entry: Mapping[str, Any], space: ParameterSpace) -> None:
    p = space[name]
    for key in ("positions", "shares"):
        if isinstance(p, Choice) and key in entry and len(entry[key]) != len(p.options):
            raise ValueError(f"{name}: `{key}` has {len(entry[key])} values for {len(p.options)} options.")
    if not isinstance(p, Choice) and entry.get("as") == "log" and p.low <= 0:
        raise ValueError(f'{name}: a parameter with as = "log" is above zero, got low = {p.low:g}.')


def _unchanged(top: Mapping[str, Any], path: Path) -> str:
    """The program with the full path of its file; raises ValueError when it is not the one that was recorded."""
    place, colon, name = top["program"].rpartition(":")
    if not colon:
        raise ValueError(f"`program` is module:function or file.py:function, got {top['program']!r}.")
    if place.endswith(".py"):
        file = path.parent / place
        if not file.is_file():
            raise ValueError(f"its program {file} is not there; correct the line `program`.")
        place = str(file.resolve())
    program = f"{place}:{name}"
    now = identity(program)
    recorded = {key: top[key] for key in ("sha256", "version") if key in top}
    if recorded and now and recorded != now:
        raise ValueError(
            f"{place} has changed since this file was written ({_listed(recorded)} then, {_listed(now)} now), so its "
            f"draws may be others. Write a new file with `dipcg generators add {top['program']}`."
        )
    return program


def _listed(identity: Mapping[str, str]) -> str:
    return ", ".join(f"{key} {value[:12]}" for key, value in identity.items())


def _prepare(program: str) -> None:
    from dipcg.tracing.programs import load

    load(program)


def _build(
    program: str,
    seed: int,
    arguments: Mapping[str, Any],
    space: ParameterSpace,
    entries: Mapping[str, Mapping[str, Any]],
    params: Params,
) -> Mesh:
    from dipcg.tracing.draws import chosen
    from dipcg.tracing.programs import run

    return run(program, seed, arguments, chosen(settings(space, entries, params)))[0]
