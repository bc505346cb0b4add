"""Contact sheets of random assets: `python -m benchmarks.sheets FOLDER [GENERATOR...]` writes NAME.png for each."""

import sys
from pathlib import Path

import numpy as np

from dipcg import registry
from dipcg.generators import load_generator
from dipcg.inference.preview import contact_sheet
from dipcg.workers.pool import BuildPool

COUNT = 24


def main(folder: str, names: list[str]) -> None:
    for name in names or [name for name in registry.names("generators") if not load_generator(name).missing]:
        with BuildPool(name, workers=2) as pool:
            many = [pool.generator.space.sample(np.random.default_rng(seed)) for seed in range(COUNT)]
            meshes = [mesh for mesh in pool.map(many) if not isinstance(mesh, Exception)]
        contact_sheet(meshes, Path(folder) / f"{name}.png")
        print(f"Wrote {folder}/{name}.png, {len(meshes)} of {COUNT}.")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
