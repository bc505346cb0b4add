"""Where estimates are wrong: `python -m benchmarks.analysis CHECKPOINT DATA FOLDER [COUNT]`.

Prints the error of every parameter over the test split, worst first, beside that of an answer that never looks at the
picture, and writes two sheets of picture, estimate from its own camera, truth and estimate from aside: NAME-first.png
with the first shapes of the split, NAME-worst.png with the ten worst by CD.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.timing import header, row
from dipcg.camera import View
from dipcg.evaluate import Case, split_cases
from dipcg.images import MARGIN, over_white, prepare, save_image
from dipcg.mesh import Mesh
from dipcg.metrics import chamfer, surface_points
from dipcg.metrics.parameter_error import per_parameter
from dipcg.pipeline import Candidate, Inverter
from dipcg.preview import in_rows
from dipcg.render import Renderer
from dipcg.space import Choice, ParameterSpace

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
    _print_errors(generator.space, found)
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


def _print_errors(space: ParameterSpace, found: list[Found]) -> None:
    """Reals: mean error in x, beside that of the middle of the range. Choices: share wrong, beside the commonest."""
    header("parameter", "error", "without looking", "active in")
    errors: dict[str, list[float]] = {name: [] for name in space.names}
    for one in found:
        assert one.case.params is not None
        for name, error in per_parameter(space, one.case.params, one.candidate.params).items():
            errors[name].append(error)
    for name in sorted(space.names, key=lambda name: -float(np.mean(errors[name] or [0]))):
        if errors[name]:
            row(name, f"{np.mean(errors[name]):.2f}", f"{_blind(space, name, found):.2f}", len(errors[name]))


def _blind(space: ParameterSpace, name: str, found: list[Found]) -> float:
    truths = [one.case.params for one in found if one.case.params and space.is_active(name, one.case.params)]
    values = [params[name] for params in truths]
    if isinstance(space[name], Choice):
        return 1 - max(values.count(value) for value in set(values)) / len(values)
    return float(np.mean([abs(space[name].encode(value)) for value in values]))


def _tiles(renderer: Renderer, one: Found) -> list[np.ndarray]:
    assert one.case.mesh is not None
    photo = over_white(prepare(one.case.image, SIDE)[0])
    drawn = [(one.mesh, one.candidate.view), (one.case.mesh, ASIDE), (one.mesh, ASIDE)]
    return [photo, *(over_white(renderer.render(mesh, view, margin=MARGIN)) for mesh, view in drawn)]


if __name__ == "__main__":
    main(*sys.argv[1:4], *map(int, sys.argv[4:5]))  # type: ignore[arg-type]
