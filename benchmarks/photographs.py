"""Pictures of a test split by another renderer than training's: Cycles with Infinigen's materials, full builds.

`python -m benchmarks.photographs NAME DATA FOLDER [COUNT]` writes NAME_0001.png with NAME_0001.npz (array `points`) for
`dipcg evaluate NAME --pairs FOLDER`; pictures that are there already are skipped.
"""

import sys
import time
from pathlib import Path

import numpy as np

from dipcg.data.shapes import load_shapes
from dipcg.generators import Generator
from dipcg.images import MARGIN, save_image
from dipcg.mesh import Mesh
from dipcg.metrics import sample_surface
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError
from dipcg.workers.rpc import Blender

COUNT, SIDE, SAMPLES, POINTS = 100, 256, 32, 20_000


def main(name: str, data: str, folder: str, count: int = COUNT) -> None:
    generator, shapes = load_shapes(data, "test")
    Path(folder).mkdir(parents=True, exist_ok=True)
    with BuildPool(generator) as pool, Blender() as blender:
        for number in range(min(count, len(shapes.x))):
            picture = Path(folder) / f"{name}_{number + 1:04d}.png"
            if picture.exists():
                continue
            started = time.perf_counter()
            try:
                mesh = pool.build(generator.space.decode(shapes.x[number].astype(float)))
            except BuildError as error:
                print(f"{picture.stem} left out: {error} {error.hint}")
                continue
            _write(blender, generator, mesh, number, picture)
            print(f"{picture} in {time.perf_counter() - started:.1f} s", flush=True)


def _write(blender: Blender, generator: Generator, mesh: Mesh, number: int, picture: Path) -> None:
    view = generator.views.sample(np.random.default_rng([7, number]))
    image = blender.call("scene:photograph", mesh, generator.ref, number, view, SIDE, SAMPLES, MARGIN)
    points = sample_surface(mesh, POINTS, np.random.default_rng(number))
    np.savez_compressed(picture.with_suffix(".npz"), points=points.astype(np.float32))
    # The picture is written last, so a pair whose picture exists is complete.
    save_image(image, picture)


if __name__ == "__main__":
    main(*sys.argv[1:4], *map(int, sys.argv[4:5]))  # type: ignore[arg-type]
