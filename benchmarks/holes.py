"""Seconds to cut the holes of baskets: Infinigen's graph with Blender's exact boolean, and the generator's way."""

import os
import sys
import time
from functools import partial

import numpy as np

from benchmarks.timing import header, machine, row
from dipcg.blender.infinigen import find_node, import_infinigen, replaced, silence
from dipcg.generators import load_generator

# Seeds of Infinigen's own assets.
SEEDS = (2, 3, 9, 13)


def main() -> None:
    print(machine() + "\n", flush=True)
    # Blender runs in a process of its own.
    child = os.fork()
    if child == 0:
        _compare()
        os._exit(0)
    os.waitpid(child, 0)


def _compare() -> None:
    header("basket of seed", "holes", "rounded", "Blender s", "here s", "ratio")
    basket, module = load_generator("basket"), import_infinigen("infinigen.assets.objects.organizer.basket")
    basket.prepare()
    own = module.geometry_nodes

    def exact(wrangler, **params) -> None:
        own(wrangler, **params)
        find_node(wrangler.node_group, "MESH_BOOLEAN").solver = "EXACT"

    for seed in SEEDS:
        np.random.seed(seed)  # noqa: NPY002 - Infinigen draws from it
        factory = module.BasketBaseFactory(seed)
        factory.params = factory.get_asset_params()
        with replaced(module, geometry_nodes=exact):
            slow = _seconds(factory.create_asset)
        fast = _seconds(partial(basket.build, _read_back(basket, factory.params)))
        about = factory.params["has_holes"], factory.params["frame_sub_level"] > 0
        row(seed, *about, f"{slow:.3f}", f"{fast:.3f}", f"{slow / fast:.0f}")


def _seconds(build) -> float:
    with silence():
        started = time.perf_counter()
        build()
        return time.perf_counter() - started


def _read_back(basket, own: dict) -> dict:
    height, hole = own["height"], own["hole_size"]
    changed = {
        "handle_depth": own["handle_depth"] / own["depth"],
        "handle_height": own["handle_height"] / height,
        "handle_dist_to_top": (own["handle_dist_to_top"] - own["handle_height"] / 2) / height,
        "hole_gap_size": own["hole_gap_size"] / hole,
        "hole_size": max(hole, 0.007),
    }
    known = {name: np.asarray(own[name]).item() for name in basket.space.names}
    return basket.space.validate(known | changed)


if __name__ == "__main__":
    sys.exit(main())
