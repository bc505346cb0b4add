"""An example of each command, which its help begins with."""

from __future__ import annotations

EXAMPLES = {
    "generators": "dipcg generators chair",
    "generators add": "dipcg generators add lamp.blend --range height=0.2:0.6",
    "generators check": "dipcg generators check my_stool.py",
    "sample": "dipcg sample chair --seed 3 --set has_arm=1 -o chair.glb",
    "estimate": "dipcg estimate photo.png -g chair -o chair.glb --params-out chair.json --preview chair.png",
    "edit": "dipcg edit chair.json --set leg_height=0.6 -o taller.glb",
    "dataset build": "dipcg dataset build chair --count 20000 -o data/chair",
    "dataset info": "dipcg dataset info data/chair",
    "dataset gallery": "dipcg dataset gallery data/chair -o chairs.png",
    "train": "dipcg train chair --data data/chair --pictures 1m",
    "evaluate": "dipcg evaluate runs/chair --data data/chair --count 100",
    "mcmc": "dipcg mcmc photo.png -g chair -o search --iterations 2000",
    "import-checkpoint": "dipcg import-checkpoint weights.safetensors -g chair -o runs",
    "serve": "dipcg serve chair table --port 7860",
    "blender-addon": "dipcg blender-addon -o dipcg.zip",
    "doctor": "dipcg doctor",
}


def example_for(words: list[str]) -> str | None:
    """The line that the help of a command begins with; None when these words ask for no command's help."""
    wants_help = any(word in ("-h", "--help") for word in words)
    return f"example: {EXAMPLES[words[0]]}\n" if wants_help and words[0] in EXAMPLES else None
