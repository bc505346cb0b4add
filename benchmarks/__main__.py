"""Run benchmarks by name: `python -m benchmarks speed builds`; all of them without a name."""

import importlib
import sys

NAMES = ("render", "builds", "holes", "sustained", "speed", "training", "accuracy", "visitors")
NAMES += ("recipe_speed", "versus", "ablation")
NAMES += ("calibration", "choosing", "recognition", "oracle")

if __name__ == "__main__":
    for name in sys.argv[1:] or NAMES:
        print(f"\n## {name}\n", flush=True)
        importlib.import_module(f"benchmarks.{name}").main()
