"""Pictures beside their estimates: `python -m benchmarks.gallery OUT.png PICTURE...` makes one row of three each.

As `dipcg estimate` does it: each picture's generator is recognised, its candidates are ranked, the first built in full.
`DIPCG_BENCH_GENERATOR` names the generator of all, `DIPCG_BENCH_COLUMNS` (2) how many stand side by side.
"""

import os
import sys
from collections.abc import Mapping

import numpy as np

from dipcg.images import save_image
from dipcg.inference.preview import in_rows, side_by_side
from dipcg.inference.rank import rank
from dipcg.inference.recognise import recognisable, recognise
from dipcg.pipeline import Inverter

NAMED = os.environ.get("DIPCG_BENCH_GENERATOR")
COLUMNS = int(os.environ.get("DIPCG_BENCH_COLUMNS", "2"))


def main(out: str, pictures: list[str]) -> None:
    inverters = {name: Inverter.load(name) for name in ([NAMED] if NAMED else recognisable())}
    try:
        save_image(in_rows([_row(inverters, picture) for picture in pictures], COLUMNS), out)
    finally:
        for inverter in inverters.values():
            inverter.close()


def _row(inverters: Mapping[str, Inverter], picture: str) -> np.ndarray:
    name = NAMED or recognise(picture, inverters)[0][0]
    found = rank(inverters[name].estimate(picture))
    print(f"{picture}: {name}, {100 * (found.candidates[0].agreement or 0):.0f} % match")
    return side_by_side(found, found.build().mesh)[::2, ::2]


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
