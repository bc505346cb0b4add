"""Pictures beside their estimates: `python -m benchmarks.gallery OUT.png PICTURE...` makes one row of three each."""

import sys

import numpy as np

from dipcg.images import save_image
from dipcg.pipeline import Inverter
from dipcg.preview import in_rows, side_by_side


def main(out: str, pictures: list[str], generator: str = "chair", columns: int = 3) -> None:
    with Inverter.load(generator, workers=2) as inverter:
        found = [inverter.estimate(picture) for picture in pictures]
        meshes = inverter.pool.map([estimate.params for estimate in found])
        rows = [_row(estimate, mesh) for estimate, mesh in zip(found, meshes, strict=True)]
    save_image(in_rows(rows, columns), out)


def _row(estimate, mesh) -> np.ndarray:
    if isinstance(mesh, Exception):
        raise mesh
    return side_by_side(estimate, mesh)[::2, ::2]


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
