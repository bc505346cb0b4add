"""Infinigen's dandelions. The middle of the range replaces draws that are no parameter.

An asset does not hold the numbers that were drawn for it, so they are recorded. The bounds of missing seeds are not
compared, because they have no effect in the factory.
"""

from typing import Any

import numpy as np

from dipcg.blender.infinigen import import_infinigen, middle, read_piece, replaced
from dipcg.generators import load_generator

# Modes of the flower.
KEYS = ("full_flower", "no_flower", "sparse_flower")
# The parameters by the range that they are drawn from, and the counts by its upper end with the published values.
UNIFORM = {(0.2, 0.4): "stem_map_range", (0.01, 0.024): "stem_radius", (-0.15, -0.5): "transform_scale"}
UNIFORM[0.3, 0.5] = "random_dropout"
COUNTS = {25: ("flower_num_core_segments", (8, 15)), 20: ("flower_num_core_rings", (8,))}
RNG = np.random.default_rng(0)


def make(key: str) -> tuple[np.ndarray, np.ndarray, dict]:
    module = import_infinigen("infinigen.assets.objects.grassland.dandelion")
    drawn: dict[str, Any] = {"flower_mode": key, "bezier": []}

    def uniform(low: float, high: float) -> float:
        if (low, high) not in UNIFORM:
            return middle(low, high)
        return drawn.setdefault(UNIFORM[low, high], RNG.uniform(*sorted((low, high))))

    def normal(mean: float, deviation: float) -> float:
        if deviation != 0.1:
            return mean
        drawn["bezier"].append(RNG.normal(mean, deviation))
        return drawn["bezier"][-1]

    def randint(low: int, high: int) -> int:
        name, values = COUNTS[high]
        return drawn.setdefault(name, int(RNG.choice(values)))

    draws = replaced(module, uniform=uniform, normal=normal, randint=randint)
    curves = replaced(module.np.random, normal=lambda mean, deviation: mean)
    with draws, curves:
        factory = module.DandelionFactory(0)
        factory.flower_mode_pb = [float(other == key) for other in factory.flower_mode]
        _, vertices, faces, *_ = read_piece("dandelion", factory.create_asset())
    return vertices, faces, drawn


def params_of(own: dict) -> dict:
    """Our parameters from the draws of the factory; one that it does not draw has no effect there."""
    space = load_generator("dandelion").space
    places = ("bezier_middle_x", "bezier_middle_y", "bezier_end_x", "bezier_end_y")
    drawn = dict(zip(places, own.pop("bezier"), strict=True)) | own
    return space.replace(space.decode(np.zeros(len(space))), drawn)
