"""The TOML file that makes a generator of a Blender file: `dipcg generators add` writes it, and people edit it."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from dipcg.blender.sockets import Place, Setting
from dipcg.mesh import Mesh
from dipcg.registry import check_allowed
from dipcg.space import Choice, Parameter, ParameterSpace, Params, Real, did_you_mean

# The identifier and the component of the input of each parameter.
Inputs = dict[str, tuple[str, str]]

# An integer of more values is a rounded real, because so many unordered options would be hard to learn.
MAX_OPTIONS = 16
TOP = ("doc", "blend", "object", "modifier", "group", "sha256", "blender", "mirrors", "parameters")
KEYS = ("input", "component", "kind", "low", "high", "options", "unit", "group", "doc", "default", "when", "why")
KINDS = ("real", "integer", "boolean", "menu")
HEADER = """\
# A generator over the Geometry Nodes of a Blender file, written by `dipcg generators add`. Edit it freely:
# - names, ranges, units and docs; `why` says how a range was proposed, and it is only a note;
# - delete a parameter, and its input keeps the value it has in the Blender file;
# - `when = {{ shade = ["Cone"] }}` for a parameter that changes nothing under other options;
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


def live_settings(path: Path, params: Params) -> tuple[str, Place, list[Setting]]:
    """The Blender that a declaration names, the place of the inputs in its file, and their settings.

    Raises as `read_declaration` does.
    """
    declared = read_declaration(path)
    place, inputs = declared.build.args
    return declared.blender, place, _settings(inputs, params)


def digest(blend: Path) -> str:
    """The SHA-256 of a file."""
    with blend.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_declaration(
    top: Mapping[str, Any],
    parameters: Mapping[str, Mapping[str, Any]],
    path: Path,
    header: str = HEADER,
    keys: Sequence[str] = KEYS,
) -> str:
    """The TOML text of a declaration; `path` is the file that it is for, `keys` are those of a parameter, in order."""
    lines = [header.format(path=path, stem=path.stem)]
    lines += [f"{key} = {_toml(value)}" for key, value in top.items() if value not in ("", [], {})]
    for name, entry in parameters.items():
        lines += ["", f"[parameters.{_key(name)}]"]
        lines += [f"{key} = {_toml(entry[key])}" for key in keys if entry.get(key) not in (None, "", [], {})]
    return "\n".join(lines) + "\n"


def _declared(top: dict[str, Any], path: Path) -> SimpleNamespace:
    check_keys(top, TOP, ("blend", "object", "sha256", "parameters"), "the file")
    for name, entry in top["parameters"].items():
        check_keys(entry, KEYS, ("input", "kind"), name)
    if top.get("blender"):
        # The program would run, and a file may name any.
        check_allowed(path)
    space = ParameterSpace(*(parameter_of(name, entry) for name, entry in top["parameters"].items()))
    blend = _unchanged(path.parent / top["blend"], top["sha256"])
    inputs = {name: (entry["input"], entry.get("component", "")) for name, entry in top["parameters"].items()}
    place = (str(blend), top["object"], top.get("modifier", ""), tuple(top.get("group", ())))
    return SimpleNamespace(
        __doc__=top.get("doc", f"The Geometry Nodes of {blend.name}."),
        space=space,
        build=partial(_build, place, inputs),
        prepare=partial(_prepare, place),
        # Inputs of a group within the modifier are no sliders of it.
        inputs={} if top.get("group") else inputs,
        mirrors=top.get("mirrors"),
        # Another Blender brings its own module.
        needs=() if top.get("blender") else ("bpy",),
        blender=top.get("blender", ""),
    )


def _prepare(place: Place) -> None:
    from dipcg.blender.geometry_nodes import open_graph

    open_graph(*place)


def _build(place: Place, inputs: Inputs, params: Params) -> Mesh:
    from dipcg.blender.geometry_nodes import evaluate, open_graph

    return evaluate(open_graph(*place), _settings(inputs, params))


def _settings(inputs: Inputs, params: Params) -> list[Setting]:
    return [(*inputs[key], value) for key, value in params.items()]


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


def parameter_of(name: str, entry: dict[str, Any]) -> Parameter:
    """The parameter that an entry of a TOML file declares; raises ValueError with a sentence."""
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


def check_keys(entry: Any, allowed: tuple[str, ...], needed: tuple[str, ...], where: str) -> None:
    """Raise ValueError for a key that is unknown or missing, with where in the file it is."""
    if not isinstance(entry, dict):
        raise ValueError(f"{where} must be a table, got {entry!r}.")
    for key in entry:
        if key not in allowed:
            raise ValueError(f"{where} has an unknown key {key!r}.{did_you_mean(key, list(allowed))}")
    missing = [key for key in needed if key not in entry]
    if missing:
        raise ValueError(f"{where} lacks {', '.join(missing)}; write it with `dipcg generators add`.")


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)


def _toml(value: Any) -> str:
    """A value in TOML, which differs from JSON here in one character; reals have the digits of single precision."""
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_key(name)} = {_toml(one)}' for name, one in value.items())} }}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
