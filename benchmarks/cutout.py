"""How well objects are cut out: renders of test shapes on grounds that the training of the segmenter did not use.

`python -m benchmarks cutout DATA... [--count 200] [--estimates 0] [--sheet FILE]`. Each DATA is a folder of
`dipcg dataset build`. The overlap is the intersection over union with the truth. With --estimates, the first pictures
are also estimated, from the cut-out and from the true one, and the chamfer distance to the truth (CD × 1000, where the
longest side is 1) is printed. The sheet shows each picture beside its cut-out.
"""

import argparse
import time
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from benchmarks.segmenter import photographs
from benchmarks.timing import header, machine, row
from dipcg.data.codec import decode_mesh
from dipcg.data.shapes import load_shapes
from dipcg.images import Cutout, ImageError, cut_out, over_white, save_image
from dipcg.inference.preview import in_rows
from dipcg.mesh import Mesh
from dipcg.metrics import surface_points
from dipcg.metrics.chamfer import measure
from dipcg.pipeline import Inverter
from dipcg.render import Renderer, sample_look
from dipcg.training.grounds import sample_scene

PHOTOGRAPHS = ("coffee", "rocket", "gravel", "grass", "hubble_deep_field")
SIDE, TILE, COLUMNS = 320, 128, 6
# The seeds of the segmenter's training are small numbers.
SEED = 20_000


class Case(NamedTuple):
    """A picture, the share of each pixel that the object covers, and the object."""

    picture: UInt8[np.ndarray, "s s 3"]
    truth: UInt8[np.ndarray, "s s"]
    generator: str
    mesh: Mesh


class Outcome(NamedTuple):
    """What was cut out of a picture, the overlap with the truth, how it was cut, and in how many seconds."""

    image: UInt8[np.ndarray, "s s 4"]
    overlap: float
    background: str
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="+", help="folders of shapes, whose test splits are used")
    parser.add_argument("--count", type=int, default=200, help="pictures")
    parser.add_argument("--estimates", type=int, default=0, help="pictures that are estimated too")
    parser.add_argument("--sheet", help="PNG of the first pictures and their cut-outs")
    args = parser.parse_args()
    print(machine() + "\n")
    cases = _cases(args.data, args.count)
    outcomes = [_cut(case) for case in cases]
    header("cut from", "n", "mean overlap", "median", "above 0.9", "below 0.5", "seconds each")
    for kind in ("plain", "photo", "all"):
        _row(kind, [one for one in outcomes if kind in (one.background, "all")])
    if args.sheet:
        _draw(cases, outcomes, args.sheet)
    if args.estimates:
        _estimate(cases[: args.estimates], outcomes[: args.estimates])


def _cases(folders: list[str], count: int) -> list[Case]:
    """Case `i` shows a shape of folder `i` modulo their number, and depends on `i` alone."""
    sets, renderer, grounds = (
        [load_shapes(folder, "test") for folder in folders],
        Renderer(SIDE),
        photographs(PHOTOGRAPHS),
    )
    cases = []
    for number in range(count):
        rng = np.random.default_rng([SEED, number])
        generator, shapes = sets[number % len(sets)]
        mesh = decode_mesh(shapes.meshes[number // len(sets) % len(shapes.meshes)])
        look = sample_look(rng, len(mesh.part_names))
        view = renderer.render(mesh, generator.views.sample(rng), look, margin=0.02)
        scene = sample_scene([view], SIDE, rng, grounds)
        cases.append(Case(scene.picture, (scene.coverage * 255).astype(np.uint8), generator.ref, mesh))
    renderer.close()
    return cases


def _cut(case: Case) -> Outcome:
    started = time.perf_counter()
    try:
        image, background = (cutout := cut_out(case.picture)).image, cutout.background
    except ImageError:
        image, background = np.zeros((SIDE, SIDE, 4), np.uint8), "nothing"
    found, truth = image[..., 3] > 127, case.truth > 127
    return Outcome(image, (found & truth).sum() / (found | truth).sum(), background, time.perf_counter() - started)


def _row(kind: str, outcomes: list[Outcome]) -> None:
    if not outcomes:
        return
    overlaps, took = np.array([one.overlap for one in outcomes]), np.mean([one.seconds for one in outcomes])
    above, below = f"{(overlaps > 0.9).mean():.0%}", f"{(overlaps < 0.5).mean():.0%}"
    row(kind, len(overlaps), f"{overlaps.mean():.3f}", f"{np.median(overlaps):.3f}", above, below, f"{took:.2f}")


def _draw(cases: list[Case], outcomes: list[Outcome], path: str) -> None:
    import cv2

    tiles = []
    for case, outcome in zip(cases[:60], outcomes, strict=False):
        pair = np.hstack([case.picture, over_white(outcome.image)])
        tiles.append(cv2.resize(pair, (2 * TILE, TILE), interpolation=cv2.INTER_AREA))
    save_image(in_rows(tiles, COLUMNS), path)


def _estimate(cases: list[Case], outcomes: list[Outcome]) -> None:
    """Print the mean CD of the expected candidate from the cut-outs, and from the true ones."""
    print()
    header("generator", "n", "CD × 1000 from the cut-out", "from the true one")
    for name in dict.fromkeys(case.generator for case in cases):
        with Inverter.load(name) as inverter:
            pairs = [(case, outcome) for case, outcome in zip(cases, outcomes, strict=True) if case.generator == name]
            own = [_distance(inverter, case, outcome.image) for case, outcome in pairs]
            true = [_distance(inverter, case, np.dstack([case.picture, case.truth])) for case, _ in pairs]
        row(name, len(own), f"{np.mean(own):.1f}", f"{np.mean(true):.1f}")


def _distance(inverter: Inverter, case: Case, image: UInt8[np.ndarray, "s s 4"]) -> float:
    # A cut-out without anything left is estimated from the whole picture.
    picture = image if (image[..., 3] > 32).any() else np.dstack([case.picture, np.full_like(case.truth, 255)])
    params = inverter.estimate(Cutout(picture, "alpha"), candidates=1).params
    clouds = [
        surface_points(m, 5000, np.random.default_rng(0)) for m in (inverter.build(params, "light").mesh, case.mesh)
    ]
    return 1000 * measure(*clouds)


if __name__ == "__main__":
    main()
