"""A generator from an OpenSCAD file: the Customizer's comments are read, and every parameter is tried."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np

from dipcg.blender.declaration import digest
from dipcg.generators import load_generator
from dipcg.importing.effects import Effects, conditions
from dipcg.importing.imported import Imported, Row
from dipcg.importing.search import find_effects
from dipcg.openscad.customizer import Entry, customizer
from dipcg.openscad.declaration import INSTALL, write_scad
from dipcg.space import Choice, Parameter
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError


def import_scad(scad: Path, output: Path | None = None, seconds: float = 600.0) -> Imported:
    """Write the TOML file that makes a generator of an OpenSCAD file.

    Raises ValueError with a sentence for a file that cannot be used, ModuleNotFoundError when `openscad` is not
    installed, and OSError when the TOML file cannot be written.
    """
    path = output or scad.with_suffix(".toml")
    if not scad.is_file():
        raise ValueError(f"There is no file {scad}.")
    if path.exists():
        raise ValueError(f"{path} is there already; delete it, or choose another with -o.")
    if shutil.which("openscad") is None:
        raise ModuleNotFoundError(f"Building {scad} needs the program openscad: run `{INSTALL}`.")
    entries, left_out = customizer(scad.read_text(encoding="utf-8", errors="replace"))
    if not entries:
        raise ValueError(
            f"{scad} has no variable that the Customizer would show; put `name = 10; // [5:20]` at its top."
        )
    inside = Path(os.path.relpath(scad.resolve(), path.parent.resolve())).as_posix()
    top = {"doc": f"The OpenSCAD file {scad.name}.", "scad": inside, "sha256": digest(scad)}
    try:
        path.write_text(write_scad(top, entries, path), encoding="utf-8")
        effects = _tried(path, scad, seconds)
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    for name in [name for name in entries if effects.sizes.get(name) == 0]:
        del entries[name]
        left_out[name] = "no effect on the mesh"
    when = conditions(load_generator(str(path)).space, list(entries), effects)
    kept = {name: entry | {"when": when[name]} for name, entry in entries.items()}
    path.write_text(write_scad(top, kept, path), encoding="utf-8")
    space = load_generator(str(path)).space
    return Imported(path, [_row(space[name], entry) for name, entry in kept.items()], left_out, effects.notes())


def _tried(path: Path, scad: Path, seconds: float) -> Effects:
    """Which parameters matter; raises ValueError when the file builds nothing as it is."""
    with BuildPool(str(path)) as pool:
        space = pool.generator.space
        try:
            pool.build(space.canonical({p.name: p.inactive for p in space}))
        except BuildError as error:
            raise ValueError(f"{scad} cannot be built: {error}") from None
        return find_effects(space, lambda many: pool.map(many, "full"), np.random.default_rng(0), seconds)


def _row(p: Parameter, entry: Entry) -> Row:
    allowed = ", ".join(map(str, p.options)) if isinstance(p, Choice) else f"{p.low:g} to {p.high:g} {p.unit}"
    return Row(p.name, str(p.inactive), allowed, entry.get("why", ""))
