"""Solids in assets: `python -m benchmarks.watertight [GENERATOR...]` counts the closed pieces of their STL files."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh

from dipcg import registry
from dipcg.export.asset import Asset
from dipcg.generators import load_generator
from dipcg.workers.pool import BuildPool

COUNT = 3


def main(names: list[str]) -> None:
    print("| generator | pieces | closed |\n|---|---|---|")
    for name in names or [name for name in registry.names("generators") if not load_generator(name).missing]:
        pieces = [piece for seed in range(COUNT) for piece in _pieces(name, seed)]
        print(f"| {name} | {len(pieces) / COUNT:.0f} | {100 * np.mean(pieces):.0f} % |", flush=True)


def _pieces(name: str, seed: int) -> list[bool]:
    """Whether each connected piece of a random asset's STL file is closed."""
    with BuildPool(name) as pool, tempfile.TemporaryDirectory() as folder:
        params = pool.generator.space.sample(np.random.default_rng(seed))
        path = Asset(pool.build(params), name, params).export(Path(folder) / "asset.stl")
        return [piece.is_watertight for piece in trimesh.load_mesh(path).split(only_watertight=False)]  # type: ignore


if __name__ == "__main__":
    main(sys.argv[1:])
