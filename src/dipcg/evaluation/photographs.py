"""Pictures of unseen shapes by Blender's Cycles with Infinigen's materials, as the paper's pictures are made."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dipcg.camera import ViewGrid, ViewRange
from dipcg.data.shapes import load_shapes
from dipcg.evaluation.evaluate import PICTURE, Case, mesh_sampler
from dipcg.images import MARGIN, save_image
from dipcg.mesh import Mesh
from dipcg.space import Params
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError
from dipcg.workers.rpc import Blender

# Samples of Cycles for each pixel; a denoiser removes the noise that is left.
SAMPLES = 32


def photographed_cases(
    folder: str | Path, count: int, views: ViewGrid | ViewRange, pictures: str | Path, split: str = "test"
) -> Iterator[Case]:
    """Pictures of a data set's unseen shapes, built in full, from one of `views` each.

    The pictures are kept as NAME_0001.png, … in the folder `pictures`; those that are there are not drawn again. A
    shape that cannot be built is left out. Raises workers.rpc.BlenderError.
    """
    generator, shapes = load_shapes(folder, split)
    Path(pictures).mkdir(parents=True, exist_ok=True)
    with BuildPool(generator) as pool, Blender() as blender:
        for number in range(min(count, len(shapes.x))):
            params = generator.space.decode(shapes.x[number].astype(float))
            if (mesh := _built(pool, params)) is None:
                continue
            picture = Path(pictures) / f"{generator.name}_{number + 1:04d}.png"
            view = views.sample(np.random.default_rng([7, number]))
            if not picture.is_file():
                arguments = mesh, generator.ref, number, view, PICTURE, SAMPLES, MARGIN
                save_image(blender.call("scene:photograph", *arguments), picture)
            yield Case(picture.stem, picture, mesh_sampler(mesh), params, mesh, view)


def _built(pool: BuildPool, params: Params) -> Mesh | None:
    try:
        return pool.build(params)
    except BuildError:
        return None
