"""From a picture to parameters and to a file, warm and cold, with the checkpoint that ships."""

import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.timing import header, machine, row, seconds
from dipcg.inference.rank import rank
from dipcg.pipeline import Inverter

PICTURE = Path(__file__).parent.parent / "examples/images/chair.png"


def main() -> None:
    print(machine() + "\n")
    header("what", "median s", "95 % s")
    with tempfile.TemporaryDirectory() as folder, Inverter.load("chair") as inverter:
        target = Path(folder) / "chair.glb"
        inverter.pool.build(inverter.estimate(PICTURE).params)

        def to_glb() -> None:
            inverter.build(inverter.estimate(PICTURE).params).export(target)

        command = [sys.executable, "-m", "dipcg.cli", "estimate", str(PICTURE), "-g", "chair", "-o", str(target)]

        def cold() -> None:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)

        _row("picture to parameters, 1 candidate", *seconds(lambda: inverter.estimate(PICTURE, candidates=1)))
        _row("picture to parameters, 16 candidates", *seconds(lambda: inverter.estimate(PICTURE, candidates=16)))
        _row("picture to GLB at full detail, warm worker", *seconds(to_glb))
        with Inverter.load("chair", workers=2) as pair:

            def ranked() -> None:
                pair.build(rank(pair.estimate(PICTURE, candidates=16), pair).params).export(target)

            _row("picture to 16 ranked candidates to the best one's GLB, two warm workers", *seconds(ranked, 5))
        _row("`dipcg estimate` from a cold start", *seconds(cold, 3))


def _row(what: str, median: float, late: float) -> None:
    row(what, f"{median:.3f}", f"{late:.3f}")


if __name__ == "__main__":
    main()
