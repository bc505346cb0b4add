"""Pictures beside their estimates: `python -m benchmarks.gallery OUT.png PICTURE...` makes one row of three each.

As `dipcg estimate` does it: each picture's generator is recognised, its candidates are ranked, the first built in full.
`DIPCG_BENCH_GENERATOR` names the generator of all, `DIPCG_BENCH_COLUMNS` (2) how many stand side by side.
"""

import os
import sys

import numpy as np

from dipcg.images import save_image
from dipcg.inference.colours import with_colours
from dipcg.inference.estimate import Options, estimate
from dipcg.inference.inverters import Inverters
from dipcg.inference.preview import in_rows, side_by_side

NAMED = os.environ.get("DIPCG_BENCH_GENERATOR")
COLUMNS = int(os.environ.get("DIPCG_BENCH_COLUMNS", "2"))


def main(out: str, pictures: list[str]) -> None:
    with Inverters([NAMED] if NAMED else []) as inverters:
        save_image(in_rows([tiles(inverters, picture, NAMED) for picture in pictures], COLUMNS), out)


def tiles(inverters: Inverters, picture: str, generator: str | None = None) -> np.ndarray:
    """The picture, its estimate from the same camera, and the estimate from aside; recognised by default."""
    found = estimate(picture, inverters, Options(generator=generator)).estimate
    print(f"{picture}: {found.generator}, {100 * (found.candidates[0].agreement or 0):.0f} % match")
    return side_by_side(found, with_colours(inverters[found.generator].build(found.params), found))[::2, ::2]


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
