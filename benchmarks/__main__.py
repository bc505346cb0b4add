"""Run one benchmark by its name: `python -m benchmarks NAME [ARGUMENTS]`; without a name, list them and run nothing."""

import ast
import runpy
import sys
from pathlib import Path

# How long each usually takes on two cores, without its longer options.
USUALLY = {
    "ablation": "hours",
    "accuracy": "20 minutes",
    "analysis": "5 minutes",
    "augmentation": "seconds",
    "builds": "5 minutes",
    "calibration": "10 minutes",
    "cards": "seconds",
    "choosing": "an hour",
    "classifier": "10 minutes",
    "cutout": "5 minutes",
    "data": "20 minutes",
    "detail": "5 minutes",
    "factories": "hours",
    "figures": "15 minutes",
    "gallery": "a minute",
    "holes": "5 minutes",
    "marathon": "hours",
    "oracle": "hours",
    "photographs": "an hour",
    "recipe_search": "hours",
    "recipe_speed": "5 minutes",
    "recognition": "an hour",
    "render": "seconds",
    "segmenter": "an hour",
    "sheets": "minutes",
    "ship": "an hour",
    "speed": "2 minutes",
    "strangers": "hours",
    "sustained": "10 minutes",
    "text_classifier": "seconds",
    "textured": "5 minutes",
    "training": "3 minutes",
    "versus": "hours",
    "views": "5 minutes",
    "visitors": "5 minutes",
    "watertight": "10 minutes",
    "wording": "5 minutes",
    "words": "a minute",
}


def main(*words: str) -> None:
    """Run the named benchmark with the other words as its arguments, or list all."""
    if not words or words[0] in ("-h", "--help"):
        return print(listing())
    name = words[0]
    if name not in USUALLY:
        raise SystemExit(f"There is no benchmark {name!r}. There are: {', '.join(USUALLY)}.")
    sys.argv = [f"benchmarks.{name}", *words[1:]]
    runpy.run_module(f"benchmarks.{name}", run_name="__main__")
    return None


def listing() -> str:
    """Every benchmark with its usual time and the first sentence of its docstring."""
    lines = [f"  {name:17}{usually:12}{_first_line(name)}" for name, usually in USUALLY.items()]
    return "\n".join(["python -m benchmarks NAME [ARGUMENTS] runs one; nothing runs without a name.", "", *lines])


def _first_line(name: str) -> str:
    doc = ast.get_docstring(ast.parse((Path(__file__).parent / f"{name}.py").read_text())) or ""
    return doc.splitlines()[0].partition(": `python")[0].rstrip(".")


if __name__ == "__main__":
    main(*sys.argv[1:])
