"""Infinigen's flowers.

An asset mixes its own draw with one of its species, and only the inputs of the graph show the result. The factory also
turns the flower at random; the mesh is read without this turn.
"""

from typing import Any

import numpy as np

from dipcg.blender.infinigen import import_infinigen, read_piece, replaced
from dipcg.mesh import Mesh

# Seeds of assets within the published ranges; most others have more petals.
KEYS = (16, 48, 66)


def make(key: int) -> tuple[np.ndarray, np.ndarray, dict]:
    module, own = import_infinigen("infinigen.assets.objects.grassland.flower"), {}
    set_inputs = module.butil.set_geomod_inputs

    def record_inputs(modifier: Any, inputs: dict) -> None:
        own.update(inputs)
        set_inputs(modifier, inputs)

    np.random.seed(key)  # noqa: NPY002
    with replaced(module.butil, set_geomod_inputs=record_inputs):
        asset = module.FlowerFactory(key, rad=1.0).create_asset()
    asset.rotation_euler.z = 0
    _, vertices, faces, *_ = read_piece("flower", asset)
    return vertices, faces, own


def params_of(own: dict) -> dict:
    """Our parameters from the inputs of the graph."""
    centre, (length, base, top) = own["Center Rad"], own["Petal Dims"]
    return {
        "overall_rad": centre + length,
        "pct_inner": centre / (centre + length),
        "base_width": 2 * np.pi * centre / base,
        "top_width": top / (centre + length),
        "min_angle": np.degrees(own["Min Petal Angle"]),
        "max_angle": np.degrees(own["Max Petal Angle"]),
        "seed_size": own["Seed Size"],
        "wrinkle": own["Wrinkle"],
        "curl": np.degrees(own["Curl"]),
    }


def check(ours: Mesh, theirs: Mesh) -> None:
    """Both have the same number of vertices."""
    assert len(ours.vertices) == len(theirs.vertices)
