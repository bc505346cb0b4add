"""Where estimates are wrong: `python -m benchmarks.analysis CHECKPOINT DATA FOLDER [COUNT]`.

Prints the error of every parameter over the test split, worst first, beside that of an answer that never looks at the
picture, and draws both as NAME-errors.png. Writes two sheets of picture, estimate from its own camera, truth and
estimate from aside: NAME-first.png with the first shapes of the split, NAME-worst.png with the ten worst by CD.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.error_figure import draw_errors, parameter_errors
from benchmarks.timing import header, row
from dipcg.camera import View
from dipcg.evaluation.evaluate import Case, split_cases
from dipcg.images import MARGIN, over_white, prepare, save_image
from dipcg.inference.preview import in_rows
from dipcg.mesh import Mesh
from dipcg.metrics import chamfer, surface_points
from dipcg.pipeline import Candidate, Inverter
from dipcg.render import Renderer
from dipcg.space import ParameterSpace

SIDE, SHOWN, WORST, POINTS = 192, 8, 10, 10_000
ASIDE = View(50.0, 25.0)


class Found(NamedTuple):
    case: Case
    candidate: Candidate
    mesh: Mesh
    distance: float


def main(checkpoint: str, data: str, folder: str, count: int = 60) -> None:
    with Inverter.load(checkpoint, workers=2) as inverter:
        generator = inverter.generator
        found = [_found(inverter, case) for case in split_cases(data, count)]
    print(f"{generator.name}: CD {np.mean([one.distance for one in found]):.3f} over {len(found)} shapes\n")
    _tell_errors(generator.space, found, Path(folder) / f"{generator.name}-errors.png")
    renderer = Renderer(SIDE)
    for name, shown in (("first", found[:SHOWN]), ("worst", sorted(found, key=lambda one: -one.distance)[:WORST])):
        path = Path(folder) / f"{generator.name}-{name}.png"
        save_image(in_rows([tile for one in shown for tile in _tiles(renderer, one)], 8), path)
        print(f"\nWrote {path}; CD {', '.join(f'{one.distance:.3f}' for one in shown)}")


def _found(inverter: Inverter, case: Case) -> Found:
    candidate = inverter.estimate(case.image, candidates=1).candidates[0]
    mesh = inverter.pool.build(candidate.params, "light")
    rng = np.random.default_rng(0)
    points = surface_points(mesh, POINTS, rng)
    return Found(case, candidate, mesh, chamfer.measure(case.sample(POINTS, rng), points))


def _tell_errors(space: ParameterSpace, found: list[Found], path: Path) -> None:
    """Print the error of every parameter beside that of an answer that never looks, and draw both."""
    pairs = [(one.case.params, one.candidate.params) for one in found if one.case.params]
    errors = parameter_errors(space, *zip(*pairs, strict=True))
    header("parameter", "error", "without looking", "active in")
    for error in errors:
        row(error.name, f"{error.error:.2f}", f"{error.blind:.2f}", error.cases)
    draw_errors(space, errors, path)
    print(f"\nWrote {path}")


def _tiles(renderer: Renderer, one: Found) -> list[np.ndarray]:
    assert one.case.mesh is not None
    photo = over_white(prepare(one.case.image, SIDE)[0])
    drawn = [(one.mesh, one.candidate.view), (one.case.mesh, ASIDE), (one.mesh, ASIDE)]
    return [photo, *(over_white(renderer.render(mesh, view, margin=MARGIN)) for mesh, view in drawn)]


if __name__ == "__main__":
    main(*sys.argv[1:4], *map(int, sys.argv[4:5]))  # type: ignore[arg-type]
