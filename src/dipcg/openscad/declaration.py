"""The TOML file that makes a generator of an OpenSCAD file, and its builds with the program `openscad`."""

from __future__ import annotations

import json
import shutil
import subprocess
import tomllib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np

from dipcg.blender.declaration import check_keys, digest, parameter_of, write_declaration
from dipcg.mesh import Mesh, make_mesh, triangulate
from dipcg.mesh.order import sort_faces
from dipcg.space import ParameterSpace, Params, Value

TOP = ("doc", "scad", "sha256", "mirrors", "parameters")
KEYS = ("variable", "component", "kind", "low", "high", "options", "unit", "group", "doc", "default", "when", "why")
# OpenSCAD has no unit; printers take its numbers as millimetres.
METRES = 0.001
TIMEOUT_S = 55.0
INSTALL = "apt-get install openscad"
HEADER = """\
# A generator over an OpenSCAD file, written by `dipcg generators add`. Edit it freely: names, ranges, units and docs;
# delete a parameter, and its variable keeps the value in the file.
# Use it: dipcg sample {path} -o {stem}.glb
"""


def read_scad(path: Path) -> SimpleNamespace:
    """The names that a Python file of a generator defines (`space`, `build`, …), from a TOML file over OpenSCAD.

    Raises LookupError when the file is not there and ValueError with a sentence when it cannot be used.
    """
    if not path.is_file():
        raise LookupError(f"There is no file {path} (looked for in {Path.cwd()}).")
    try:
        return _declared(tomllib.loads(path.read_text(encoding="utf-8")), path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_scad(top: Mapping[str, Any], parameters: Mapping[str, Mapping[str, Any]], path: Path) -> str:
    """The TOML text of a declaration over an OpenSCAD file."""
    return write_declaration(top, parameters, path, HEADER, KEYS)


def assignments(entries: Mapping[str, Mapping[str, Any]], params: Params) -> dict[str, str]:
    """The value of each variable in OpenSCAD's language; components of a vector become one list."""
    found: dict[str, Any] = {}
    for name, entry in entries.items():
        value = _plain(entry, params[name])
        if "component" in entry:
            found.setdefault(entry["variable"], []).append(value)
        else:
            found[entry["variable"]] = value
    return {name: json.dumps(value) for name, value in found.items()}


def read_off(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of an OFF file; polygons are cut into fans."""
    # The counts stand behind the word OFF or on the next line; a face may have a colour behind its corners.
    rows = [line.split() for line in text.removeprefix("OFF").splitlines() if line.strip()]
    count, faces = int(rows[0][0]), int(rows[0][1])
    vertices = np.array([row[:3] for row in rows[1 : 1 + count]], float).reshape(-1, 3)
    polygons = [row[1 : 1 + int(row[0])] for row in rows[1 + count : 1 + count + faces]]
    sizes = np.array([len(polygon) for polygon in polygons], np.int32)
    corners = np.array([corner for polygon in polygons for corner in polygon], np.int32)
    return vertices, triangulate(sizes, corners)[0] if len(sizes) else np.zeros((0, 3), np.int32)


def _declared(top: dict[str, Any], path: Path) -> SimpleNamespace:
    check_keys(top, TOP, ("scad", "sha256", "parameters"), "the file")
    entries = top["parameters"]
    for name, entry in entries.items():
        check_keys(entry, KEYS, ("variable", "kind"), name)
    scad = path.parent / top["scad"]
    if not scad.is_file():
        raise ValueError(f"its OpenSCAD file {scad} is not there; correct the line `scad`.")
    if digest(scad) != top["sha256"]:
        raise ValueError(f"{scad} has changed since this file was written. Write it anew with `dipcg generators add`.")
    return SimpleNamespace(
        __doc__=top.get("doc", f"The OpenSCAD file {scad.name}."),
        space=ParameterSpace(*(parameter_of(name, entry) for name, entry in entries.items())),
        build=partial(_build, str(scad.resolve()), entries),
        mirrors=top.get("mirrors"),
    )


def _build(scad: str, entries: Mapping[str, Mapping[str, Any]], params: Params) -> Mesh:
    """Build with `openscad`; raises ValueError with what it says, and ModuleNotFoundError when it is not installed."""
    program = shutil.which("openscad")
    if program is None:
        raise ModuleNotFoundError(f"The program openscad is missing: run `{INSTALL}`, then `dipcg doctor`.")
    settings = [word for name, value in assignments(entries, params).items() for word in ("-D", f"{name}={value}")]
    with TemporaryDirectory(prefix="dipcg-") as folder:
        target = Path(folder) / "made.off"
        try:
            done = subprocess.run(
                [program, "-o", str(target), *settings, scad],
                capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S, stdin=subprocess.DEVNULL,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise ValueError(f"OpenSCAD took longer than {TIMEOUT_S:g} s and was stopped") from None
        _check_output(done, target)
        vertices, faces = read_off(target.read_text())
    return sort_faces(make_mesh(vertices * METRES, faces))


def _check_output(done: subprocess.CompletedProcess[str], target: Path) -> None:
    """Raise ValueError when OpenSCAD failed, or went on without a file, or with one that it should not read."""
    lines = [line.strip() for line in done.stderr.splitlines()]
    # The old linear_extrude(file) reads drawings beside the file, whatever is in the variable that names one; its hash
    # would not change with them, and a file of a stranger must stand alone.
    missing = [line for line in lines if "Can't open" in line or "Support for reading files in" in line]
    errors = missing or [line for line in lines if "ERROR" in line or "empty" in line]
    if missing or done.returncode or not target.is_file():
        raise ValueError(f"OpenSCAD says: {(errors or lines or ['nothing'])[0].rstrip('.')}")


def _plain(entry: Mapping[str, Any], value: Value) -> Any:
    return round(float(value)) if entry["kind"] == "integer" and not isinstance(value, str) else value
