"""Triangles, bytes and seconds of each detail and level of detail, and how far each is from the full surface.

`python -m benchmarks.detail [NAME...]` prints a table in Markdown; a level, such as LOD1, is made as `--lods` makes it.
The first build of a process is not timed. The largest deviation is that of 3,000 points of the full surface, in shares
of the longest side.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float
from trimesh.proximity import closest_point
from trimesh.sample import sample_surface

from dipcg.export.asset import Asset
from dipcg.generators import Detail
from dipcg.mesh import Mesh
from dipcg.mesh.copies import find_copies
from dipcg.workers.pool import BuildPool

NAMES = ("chair", "table", "vase", "basket", "flower", "dandelion")
# Each with the number of the coarser level.
DETAILS: tuple[tuple[Detail, int], ...] = (
    ("full", 0), ("standard", 0), ("light", 0), ("standard", 1), ("standard", 2), ("standard", 3)
)  # fmt: skip
SEEDS = (3, 4, 5)
POINTS = 3000


def main() -> None:
    """Print the table."""
    print("| generator | detail | triangles | of copies | GLB, kB | build, s | write, s | deviation |")
    print("|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:] or NAMES:
        with BuildPool(name, timeout_s=300) as pool:
            pool.build(pool.generator.space.sample(np.random.default_rng(0)), "light")
            for detail, level in DETAILS:
                every = [_measured(pool, seed, detail, level) for seed in SEEDS]
                row = [f"{low:.3g}–{high:.3g}" for low, high in zip(np.min(every, 0), np.max(every, 0), strict=True)]
                print(f"| {name} | {f'LOD{level}' if level else detail} | " + " | ".join(row) + " % |", flush=True)


def _measured(pool: BuildPool, seed: int, detail: Detail, level: int) -> list[float]:
    """Triangles, those of copies, kilobytes, seconds to build and to write, deviation in percent."""
    params = pool.generator.space.sample(np.random.default_rng(seed))
    started = time.perf_counter()
    asset = Asset(pool.build(params, detail), pool.generator.name, params)
    asset = asset.coarser(level) if level else asset
    mesh = asset.mesh
    built = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        size = asset.export(Path(folder) / "a.glb").stat().st_size
    written = time.perf_counter()
    copied = sum(copies.faces.size for copies in find_copies(mesh))
    far = 0.0 if detail == "full" else _deviation(pool.build(params, "full"), mesh)
    return [len(mesh.faces), copied, size / 1000, built - started, written - built, 100 * far]


def _deviation(full: Mesh, mesh: Mesh) -> float:
    """The largest distance of points of the full surface from the other, in longest sides."""
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    near = closest_point(surface, _points(full, np.random.default_rng(0)))[1]
    return float(near.max()) / full.side


def _points(mesh: Mesh, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return sample_surface(surface, POINTS, seed=int(rng.integers(2**31)))[0]


if __name__ == "__main__":
    main()
