"""How near estimates come: a test split (`DIPCG_BENCH_DATA`) and pairs of picture and points (`DIPCG_BENCH_PAIRS`)."""

import os

from dipcg.cli.terminal import differences, table
from dipcg.evaluation.baselines import built_shapes, stored_shapes
from dipcg.evaluation.evaluate import Plan, evaluate, pair_cases, split_cases
from dipcg.pipeline import Inverter

COUNT = int(os.environ.get("DIPCG_BENCH_SHAPES", "100"))
# Random shapes; the one nearest to the truth is a row of the table.
RANDOM = 200


def main() -> None:
    data, pairs = os.environ.get("DIPCG_BENCH_DATA"), os.environ.get("DIPCG_BENCH_PAIRS")
    if not data and not pairs:
        print(
            "Skipped: set DIPCG_BENCH_DATA to a folder of `dipcg dataset build`, or DIPCG_BENCH_PAIRS to one of pairs."
        )
    with Inverter.load("chair", workers=2) as inverter:
        if data:
            found = evaluate(
                inverter, split_cases(data, COUNT), Plan(metrics=["all"], random_shapes=stored_shapes(data, RANDOM))
            )
            print(f"Test split, {COUNT} shapes:\n\n{table(found)}\n\n{differences(found)}")
        if pairs:
            shapes = built_shapes(inverter.pool, RANDOM)
            found = evaluate(
                inverter, pair_cases(pairs, "chair"), Plan(metrics=["all"], quarter_turns=True, random_shapes=shapes)
            )
            print(f"\nPairs, at the best of four quarter turns:\n\n{table(found)}\n\n{differences(found)}")


if __name__ == "__main__":
    main()
