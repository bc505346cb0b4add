"""The paper's figures from the pictures that ship: `python -m benchmarks figures FOLDER [NAME...]` writes NAME.png.

photos: figures 1 and 3, pictures beside their estimates. sketches: figure 5, a drawing and the outlines of pictures.
mcmc: figure 6, the best of Metropolis-Hastings after more and more calls of the generator, and the estimate.
edits: figure 7. failures: figure 8, pictures of what a generator cannot make. Figure 4 shows other tools; for it,
`dipcg evaluate --meshes` measures their meshes. DIPCG_BENCH_CALLS (1000) are the calls of the search.
"""

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from examples.edits import main as draw_edits

from benchmarks.gallery import tiles
from benchmarks.trained import run
from dipcg.images import edges, load_image, over_white, prepare, save_image
from dipcg.inference.inverters import Inverters
from dipcg.inference.preview import in_rows

CALLS = os.environ.get("DIPCG_BENCH_CALLS", "1000")
PICTURES = Path(__file__).parents[1] / "examples" / "images"
PHOTOS = ("chair", "armchair", "table", "vase", "basket", "flower", "dandelion")
# Pictures whose outlines are drawings too.
OUTLINED = ("armchair", "table", "vase")
# Pictures, and generators that make other things.
FOREIGN = (("flower", "vase"), ("basket", "table"), ("vase", "chair"))
SIDE = 256


def main(folder: str, *names: str) -> None:
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name in names or FIGURES:
        if name not in FIGURES:
            raise SystemExit(f"There is no figure {name!r}. There are: {', '.join(FIGURES)}.")
        target = Path(folder) / f"{name}.png"
        FIGURES[name](target)
        print(f"Wrote {target}.", flush=True)


def photos(target: Path) -> None:
    with Inverters() as inverters:
        save_image(in_rows([tiles(inverters, str(PICTURES / f"{name}.png")) for name in PHOTOS], 2), target)


def sketches(target: Path) -> None:
    with tempfile.TemporaryDirectory() as folder, Inverters() as inverters:
        drawings = [PICTURES / "sketch.png", *(outline(name, Path(folder)) for name in OUTLINED)]
        save_image(in_rows([tiles(inverters, str(drawing)) for drawing in drawings], 2), target)


def outline(name: str, folder: Path) -> Path:
    """Canny's edges of a picture that ships, black on white, as a file in the folder."""
    save_image(edges(prepare(PICTURES / f"{name}.png", 2 * SIDE)[0]), folder / f"{name}.png")
    return folder / f"{name}.png"


def mcmc(target: Path) -> None:
    picture = str(PICTURES / "chair.png")
    with tempfile.TemporaryDirectory() as folder, Inverters(["chair"]) as inverters:
        run("mcmc", picture, "-g", "chair", "-o", folder, "--iterations", CALLS)
        found = over_white(load_image(Path(folder) / "best.png"))
        ours = tiles(inverters, picture, "chair")
    height, width = (round(side * SIDE / ours.shape[0]) for side in ours.shape[:2])
    ours = cv2.resize(ours, (width, height), interpolation=cv2.INTER_AREA)
    rows = [
        np.pad(row, ((0, 0), (0, max(width, found.shape[1]) - row.shape[1]), (0, 0)), constant_values=255)
        for row in (ours, found)
    ]
    save_image(np.concatenate(rows), target)


def edits(target: Path) -> None:
    draw_edits(str(target))


def failures(target: Path) -> None:
    with Inverters() as inverters:
        save_image(
            in_rows([tiles(inverters, str(PICTURES / f"{name}.png"), other) for name, other in FOREIGN], 1), target
        )


FIGURES: dict[str, Callable[[Path], None]] = {
    "photos": photos,
    "sketches": sketches,
    "mcmc": mcmc,
    "edits": edits,
    "failures": failures,
}


if __name__ == "__main__":
    main(*sys.argv[1:])
