"""The TOML file that makes a generator of a Blender file: `dipcg generators add` writes it, and people edit it."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from dipcg.mesh import Mesh
from dipcg.space import Choice, Parameter, ParameterSpace, Params, Real, Value, did_you_mean

# The identifier of a socket, a component, and a value, as in `geometry_nodes`.
Setting = tuple[str, str, Value]

# An integer of more values is a rounded real, because so many unordered options would be hard to learn.
MAX_OPTIONS = 16
TOP = ("doc", "blend", "object", "sha256", "mirrors", "parameters")
KEYS = ("input", "component", "kind", "low", "high", "options", "unit", "group", "doc", "default", "when")
KINDS = ("real", "integer", "boolean", "menu")
HEADER = """\
# A generator over the Geometry Nodes of a Blender file, written by `dipcg generators add`. Edit it freely:
# - names, limits, units and docs; delete a parameter, and its input keeps the value it has in the Blender file;
# - `when = {{ shade = ["cone", "bell"] }}` for a parameter that changes nothing under other options;
# - `mirrors = {{}}` below if every asset is its own mirror image, left to right, or `mirrors = {{ turn = "-turn" }}` if
#   it is one with that parameter turned round: training then also learns from flipped pictures.
# Use it: dipcg sample {path} -o {stem}.glb
"""


def read_declaration(path: Path) -> SimpleNamespace:
    """The names that a Python file of a generator defines (`space`, `build`, …), from a TOML file.

    Raises LookupError when the file is not there and ValueError with a sentence when it or its Blender file cannot be
    used.
    """
    if not path.is_file():
        raise LookupError(f"There is no file {path} (looked for in {Path.cwd()}).")
    try:
        return _declared(tomllib.loads(path.read_text(encoding="utf-8")), path)
    except ValueError as error:
        # Errors of UTF-8 and of TOML are ValueErrors too.
        raise ValueError(f"{path}: {error}") from None


def live_settings(path: Path, params: Params) -> tuple[str, str, list[Setting]]:
    """The Blender file of a declaration, the name of the object, and the settings of its modifier's inputs.

    Raises as `read_declaration` does.
    """
    blend, name, places = read_declaration(path).build.args
    return blend, name, _settings(places, params)


def digest(blend: Path) -> str:
    """The SHA-256 of a file."""
    with blend.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_declaration(top: Mapping[str, Any], parameters: Mapping[str, Mapping[str, Any]], path: Path) -> str:
    """The TOML text of a declaration; `path` is the file that it is for."""
    lines = [HEADER.format(path=path, stem=path.stem), *(f"{key} = {_toml(value)}" for key, value in top.items())]
    for name, entry in parameters.items():
        lines += ["", f"[parameters.{name if name.isascii() else _toml(name)}]"]
        lines += [f"{key} = {_toml(entry[key])}" for key in KEYS if entry.get(key) not in (None, "", [])]
    return "\n".join(lines) + "\n"


def _declared(top: dict[str, Any], path: Path) -> SimpleNamespace:
    _check_keys(top, TOP, ("blend", "object", "sha256", "parameters"), "the file")
    for name, entry in top["parameters"].items():
        _check_keys(entry, KEYS, ("input", "kind"), name)
    space = ParameterSpace(*(_parameter(name, entry) for name, entry in top["parameters"].items()))
    blend = _unchanged(path.parent / top["blend"], top["sha256"])
    places = {name: (entry["input"], entry.get("component", "")) for name, entry in top["parameters"].items()}
    return SimpleNamespace(
        __doc__=top.get("doc", f"The Geometry Nodes of {blend.name}."),
        space=space,
        build=partial(_build, str(blend), top["object"], places),
        prepare=partial(_prepare, str(blend), top["object"]),
        mirrors=top.get("mirrors"),
        needs=("bpy",),
    )


def _prepare(blend: str, name: str) -> None:
    from dipcg.blender.geometry_nodes import open_graph

    open_graph(blend, name)


def _build(blend: str, name: str, places: dict[str, tuple[str, str]], params: Params) -> Mesh:
    from dipcg.blender.geometry_nodes import evaluate, open_graph

    return evaluate(open_graph(blend, name), _settings(places, params))


def _settings(places: dict[str, tuple[str, str]], params: Params) -> list[Setting]:
    return [(*places[key], value) for key, value in params.items()]


def _unchanged(blend: Path, expected: str) -> Path:
    if not blend.is_file():
        raise ValueError(f"its Blender file {blend} is not there; correct the line `blend`.")
    actual = digest(blend)
    if actual != expected:
        raise ValueError(
            f"{blend} has changed since this file was written, so its inputs may be others. Write a new one with "
            f'`dipcg generators add {blend}`, or if they are the same, put sha256 = "{actual}" here.'
        )
    return blend.resolve()


def _parameter(name: str, entry: dict[str, Any]) -> Parameter:
    if not name.isidentifier():
        raise ValueError(f"a parameter's name is made of letters, digits and _, got {name!r}.")
    shared: dict[str, Any] = {key: entry[key] for key in ("unit", "doc", "group", "default") if key in entry}
    shared["when"] = {other: tuple(options) for other, options in entry.get("when", {}).items()}
    if entry["kind"] == "boolean":
        return Choice(name, (False, True), **shared)
    if entry["kind"] == "menu":
        return Choice(name, tuple(entry.get("options", ())), **shared)
    if entry["kind"] not in KINDS:
        raise ValueError(f"{name}: the kind is one of {', '.join(KINDS)}, got {entry['kind']!r}.")
    low, high = _limits(name, entry)
    if entry["kind"] == "integer" and 1 <= high - low < MAX_OPTIONS:
        return Choice(name, tuple(range(round(low), round(high) + 1)), **shared)
    if "default" in shared:
        shared["default"] = float(shared["default"])
    return Real(name, float(low), float(high), **shared)


def _limits(name: str, entry: dict[str, Any]) -> tuple[float, float]:
    low, high = entry.get("low"), entry.get("high")
    if not isinstance(low, (int, float)) or not isinstance(high, (int, float)):
        raise ValueError(f"{name}: `low` and `high` must be numbers, got {low!r} and {high!r}.")
    return float(low), float(high)


def _check_keys(entry: Any, allowed: tuple[str, ...], needed: tuple[str, ...], where: str) -> None:
    if not isinstance(entry, dict):
        raise ValueError(f"{where} must be a table, got {entry!r}.")
    for key in entry:
        if key not in allowed:
            raise ValueError(f"{where} has an unknown key {key!r}.{did_you_mean(key, list(allowed))}")
    missing = [key for key in needed if key not in entry]
    if missing:
        raise ValueError(f"{where} lacks {', '.join(missing)}; write it with `dipcg generators add`.")


def _toml(value: Any) -> str:
    """A value in TOML, which differs from JSON here in one character; reals have the digits of single precision."""
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
