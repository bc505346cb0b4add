"""CD against the number of pictures of one object: `python -m benchmarks.views CHECKPOINT DATA [COUNT]`."""

import sys

import numpy as np

from benchmarks.timing import header, row
from dipcg.data.codec import decode_mesh
from dipcg.data.shapes import load_shapes
from dipcg.images import MARGIN
from dipcg.metrics import chamfer, surface_points
from dipcg.pipeline import Inverter
from dipcg.render import Renderer, sample_look

PICTURES, SIDE, POINTS = (1, 2, 3, 4), 256, 10_000


def main(checkpoint: str, data: str, count: int = 40) -> None:
    _, shapes = load_shapes(data, "test")
    renderer, rng = Renderer(SIDE), np.random.default_rng(0)
    with Inverter.load(checkpoint, workers=2) as inverter:
        found = np.array([_distances(inverter, renderer, shapes.meshes[i], rng) for i in range(count)])
    header("pictures", f"CD over {len(found)} shapes", "against one picture")
    for pictures, mean in zip(PICTURES, found.mean(0), strict=True):
        row(pictures, f"{mean:.4f}", f"{mean / found[:, 0].mean():.2f}")


def _distances(inverter: Inverter, renderer: Renderer, packed: bytes, rng: np.random.Generator) -> list[float]:
    mesh, views = decode_mesh(packed), inverter.generator.views
    looks = [sample_look(rng, len(mesh.part_names)) for _ in PICTURES]
    images = [np.ascontiguousarray(renderer.render(mesh, views.sample(rng), look, MARGIN)) for look in looks]
    truth = surface_points(mesh, POINTS, rng)
    many = [inverter.estimate_views(images[:pictures], candidates=1).params for pictures in PICTURES]
    built = [inverter.pool.build(params, "light") for params in many]
    return [chamfer.measure(truth, surface_points(one, POINTS, rng)) for one in built]


if __name__ == "__main__":
    main(*sys.argv[1:3], *map(int, sys.argv[3:4]))  # type: ignore[arg-type]
