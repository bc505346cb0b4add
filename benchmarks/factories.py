"""Infinigen's object factories as generators: `python -m benchmarks factories [NAME...]` makes table and gallery.

Each is added as `dipcg generators add` does it, random shapes are timed and drawn, and the contracts are checked as
`dipcg generators check` does it. What is done stays in DIPCG_BENCH_CACHE (~/.cache/dipcg/factories),
so that a stopped run continues; DIPCG_BENCH_SECONDS (600) is the time for each, DIPCG_BENCH_TABLE and
DIPCG_BENCH_GALLERY are files to write.
"""

import json
import os
import re
import sys
import textwrap
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.timing import machine
from dipcg.files import write_file
from dipcg.images import load_image, save_image
from dipcg.importing.contracts import check
from dipcg.importing.seeded import import_program
from dipcg.inference.preview import contact_sheet, in_rows
from dipcg.mesh import Mesh
from dipcg.mesh.simplify import simplify
from dipcg.registry import allow_code
from dipcg.tracing.sites import snake
from dipcg.workers.pool import BuildPool

CACHE = Path(os.environ.get("DIPCG_BENCH_CACHE", "~/.cache/dipcg/factories")).expanduser()
SECONDS = float(os.environ.get("DIPCG_BENCH_SECONDS", "600"))
# The folders of Infinigen's objects, those that furnish a room first.
FOLDERS = (
    "seating,tables,shelves,lamp,tableware,table_decorations,wall_decorations,elements,bathroom,windows,mushroom,"
    "cactus,small_plants,tropic_plants,monocot,mollusk,decor,rocks,organizer,corals,clothes,fruits,grassland,appliances"
)
SHAPES = 4
# The longest reason in the table, in characters.
REASON = 240
SIZE, COLUMNS, GALLERY = 128, 8, 40


def main(names: list[str]) -> None:
    CACHE.mkdir(parents=True, exist_ok=True)
    for name in names or list(factories()):
        result = done(name)
        print(f"{name}: {result['reason'] or str(result['parameters']) + ' parameters'}", flush=True)
    results = [done(name) for name in (names or factories()) if (CACHE / f"{name}.json").exists()]
    text = table(results)
    print(f"\n{machine()}\n\n{text}")
    if "DIPCG_BENCH_TABLE" in os.environ:
        write_file(os.environ["DIPCG_BENCH_TABLE"], text + "\n")
    if "DIPCG_BENCH_GALLERY" in os.environ:
        gallery(results, os.environ["DIPCG_BENCH_GALLERY"])


def factories() -> dict[str, str]:
    """Infinigen's object factories by name, with their modules, without those that others are made of."""
    spec = find_spec("infinigen")
    assert spec is not None
    assert spec.submodule_search_locations
    root = Path(spec.submodule_search_locations[0])
    found: dict[str, str] = {}
    for folder in FOLDERS.split(","):
        for path in sorted((root / "assets/objects" / folder).rglob("*.py")):
            module = ".".join(path.relative_to(root.parent).with_suffix("").parts)
            names = re.findall(r"^class (\w+Factory)\(", path.read_text(), re.MULTILINE)
            found |= {name: module for name in names if not name.startswith("Base") and "BaseFactory" not in name}
    return found


def done(name: str) -> dict[str, Any]:
    """The stored result of a factory, or a new one."""
    file = CACHE / f"{name}.json"
    result = json.loads(file.read_text()) if file.exists() else tried(name)
    if not result["reason"] and not result.get("checked"):
        path = CACHE / f"{snake(name)}.toml"
        allow_code(path)
        result |= {"checked": True, "reason": " ".join(found.text for found in check(str(path)) if not found.is_hint)}
    write_file(file, json.dumps(result))
    return result


def tried(name: str) -> dict[str, Any]:
    """Add a factory, build random shapes, draw the first: parameters, seconds a build, or why it fails."""
    path = CACHE / f"{snake(name)}.toml"
    path.unlink(missing_ok=True)
    result: dict[str, Any] = {"name": name, "parameters": 0, "seconds": None, "reason": ""}
    started = time.monotonic()
    try:
        made = import_program(f"{factories()[name]}:{name}", output=path, seconds=SECONDS)
    except ValueError as error:
        return result | {"reason": " ".join(str(error).split()), "added_s": time.monotonic() - started}
    meshes, seconds = built(path)
    if not meshes:
        return result | {"reason": "none of its builds worked"}
    contact_sheet([simplify(meshes[0], 20_000)], CACHE / f"{name}.png", 1, SIZE)
    left_out = [why for why in made.left_out.values() if "no time" in why]
    return result | {
        "parameters": len(made.rows),
        "seconds": float(np.median(seconds)),
        "failed": SHAPES - len(meshes),
        "added_s": time.monotonic() - started,
        "reason": "no time was left to try all its parameters" if left_out else "",
    }


def built(path: Path) -> tuple[list[Mesh], list[float]]:
    """Meshes of random parameters and the seconds that they took; failed ones are left out."""
    with BuildPool(str(path)) as pool:
        rng = np.random.default_rng(3)
        many = list(pool.timed((pool.generator.space.sample(rng) for _ in range(SHAPES)), "full"))
    good = [(one.mesh, one.seconds) for one in many if isinstance(one.mesh, Mesh) and one.seconds is not None]
    return [mesh for mesh, _ in good], [seconds for _, seconds in good]


def table(results: list[dict[str, Any]]) -> str:
    """A table in Markdown: those that pass, then those that fail with the reason."""
    lines = ["| factory | parameters | seconds a build |", "|---|---|---|"]
    passed = [one for one in results if not one["reason"]]
    lines += [f"| {one['name']} | {one['parameters']} | {one['seconds']:.2f} |" for one in passed]
    failed = [one for one in results if one["reason"]]
    lines += ["", f"{len(passed)} of {len(results)} pass. The others:", "", "| factory | reason |", "|---|---|"]
    return "\n".join(lines + [f"| {one['name']} | {shortened(one['reason'])} |" for one in failed])


def shortened(reason: str) -> str:
    """A reason without the name of the module, in one line of the table."""
    return textwrap.shorten(re.sub(r"^infinigen\S+ (cannot be recorded: )?", "", reason), REASON, placeholder=" …")


def gallery(results: list[dict[str, Any]], file: str) -> None:
    """The pictures of the first of those that pass, in rows."""
    passed = [one["name"] for one in results if not one["reason"]][:GALLERY]
    pictures = [load_image(CACHE / f"{name}.png")[..., :3] for name in passed]
    save_image(in_rows(pictures, COLUMNS), file)


if __name__ == "__main__":
    main(sys.argv[1:])
