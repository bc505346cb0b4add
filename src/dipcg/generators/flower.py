"""Infinigen's flower with the paper's 9 parameters.

A thin adapter: Infinigen's function makes the node graph once for each part in each process, and a build sets its
inputs. The first petal points to +X, and each next petal is turned by one radian; the factory turns the whole flower at
random. Noise, wrinkles and seeds have fixed places in the graph.

What the parameters do:
- A flower has 1.2 times `base_width` petals, rounded down, so that they overlap by a fifth.
- `top_width` is at least 1.2 times the width of the base in metres, and the graph limits the widening of a petal to one
  metre.
- The published pair of angles is sorted, so that two sets of parameters give the same flower. Here the smaller angle is
  also that of the first petals, but where `min_angle` is the larger one the flower is mirrored: its petals follow each
  other in the opposite direction.
- Seeds are spikes, also on the lower side of the centre, and have up to a million faces. Light meshes have fewer and
  wider seeds where single seeds cannot be told apart.

Sources: Infinigen (Raistrick et al. 2023) for the factory, DI-PCG's published parameters for list and ranges.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from dipcg.blender.infinigen import (
    evaluated,
    find_node,
    graph_object,
    graph_of,
    import_infinigen,
    new_graph,
    read_piece,
    set_inputs,
    set_node,
    silence,
)
from dipcg.camera import ViewRange
from dipcg.mesh import Mesh, Solid, join
from dipcg.space import ParameterSpace, Params, Real

space = ParameterSpace(
    Real("overall_rad", 0.7, 1.3, unit="m", doc="of the open flower", group="petal"),
    Real("pct_inner", 0.05, 0.5, unit="of radius", doc="radius of the centre", group="centre"),
    Real(
        "base_width",
        4,
        16,
        unit="per round",
        doc="petals side by side around the centre, of which there are a fifth more",
        group="petal",
    ),
    Real("top_width", 0.0, 1.6, unit="of radius", doc="width of a petal at its tip", group="petal"),
    Real("min_angle", -20, 100, unit="°", doc="how far the first petals are raised", group="petal"),
    Real("max_angle", -20, 100, unit="°", doc="how far the last petals are raised", group="petal"),
    Real("seed_size", 0.005, 0.03, unit="m", doc="radius of the seeds, and a tenth of their length", group="centre"),
    Real("wrinkle", 0.003, 0.02, unit="m", doc="depth of the wrinkles", group="petal"),
    Real("curl", -120, 120, unit="°", doc="how far petals bend", group="petal"),
)
# What people read for the names of Infinigen.
labels = {
    "overall_rad": "radius", "pct_inner": "radius", "base_width": "width at the base",
    "top_width": "width at the tip", "min_angle": "angle of the first petals",
    "max_angle": "angle of the last petals", "seed_size": "size of the seeds", "wrinkle": "wrinkles",
}  # fmt: skip
# A flower that is turned by one radian looks the same, because the next petal takes the place of each.
views = ViewRange(azimuth_deg=(-30, 30), elevation_deg=(5, 75))
mirrors = {"min_angle": "max_angle", "max_angle": "min_angle"}
needs = ("infinigen", "bpy")

# The radius of a seed as a share of the centre's radius. At the first there are some 300 seeds, and a light mesh gives
# each fewer corners if there are more; at the second there are some 1,000, and a light mesh has no more.
_COARSE_BELOW, _SPACED_AT_LEAST = 0.075, 0.04
# The factor of the radius that gives a seed with 4 sides the girth of one with 6 sides.
_SQUARE_SEED_SCALE = 1.09
_MODULE = "infinigen.assets.objects.grassland.flower"


@functools.cache
def prepare() -> dict[str, Any]:
    """Import Infinigen and make the node graphs that all builds use, one for each part, as objects."""
    module = import_infinigen(_MODULE)
    with silence():
        return {part: graph_object(_graph(module, link)) for part, link in (("petal", 0), ("centre", 1))}


def _graph(module: Any, part: int) -> Any:
    """The graph of the flower with one of the two parts that it joins."""
    graph = new_graph(module.geo_flower, {}, petal_material=None, center_material=None)
    joined = find_node(graph, "SET_SHADE_SMOOTH").inputs[0].links[0].from_node
    graph.links.remove(joined.inputs[0].links[1 - part])
    return graph


def build(params: Params) -> Mesh:
    """The full mesh of the flower."""
    return _build(params, light=False)


def build_light(params: Params) -> Mesh:
    """A mesh whose seeds have fewer corners; where there are very many, they are fewer and wider and as high."""
    return _build(params, light=True)


def _build(p: Any, light: bool) -> Mesh:
    inputs = _inputs(p)
    with silence():
        pieces = [_petals(inputs), _centre(inputs, light)]
    return join([_mirrored(piece) for piece in pieces] if p["min_angle"] > p["max_angle"] else pieces)


def _petals(inputs: dict[str, Any]) -> Solid:
    obj = prepare()["petal"]
    set_inputs(obj, inputs)
    return read_piece("petal", evaluated(obj))


def _centre(inputs: dict[str, Any], light: bool) -> Solid:
    """The centre with its seeds, which in Infinigen are 10 times as long as their radius and 1.5 times as far apart."""
    obj, size, bed = prepare()["centre"], inputs["Seed Size"], inputs["Center Rad"]
    coarse = light and size < _COARSE_BELOW * bed
    spaced = max(size, _SPACED_AT_LEAST * bed) if coarse else size
    radius = _SQUARE_SEED_SCALE * spaced if coarse else size
    set_inputs(obj, inputs | {"Seed Size": radius})
    seed = find_node(graph_of(obj), "nodegroup_plant_seed")
    set_node(seed, {"U": 3, "V": 4} if coarse else {"U": 6, "V": 6})
    points = find_node(graph_of(obj), "DISTRIBUTE_POINTS_ON_FACES")
    _source_node(_source_node(seed, "Dimensions"), "X").inputs[1].default_value = 10 * size / radius
    _source_node(points, "Distance Min").inputs[1].default_value = 1.5 * spaced / radius
    return read_piece("centre", evaluated(obj))


def _mirrored(piece: Solid) -> Solid:
    mirrored = piece.vertices * np.array([-1, 1, 1], np.float32)
    return piece._replace(vertices=mirrored, faces=piece.faces[:, ::-1])


def _source_node(node: Any, name: str) -> Any:
    """The node that is linked to an input."""
    return node.inputs[name].links[0].from_node


def _inputs(p: Any) -> dict[str, Any]:
    """The inputs of the graph, in its own units, from the parameters."""
    centre = p["overall_rad"] * p["pct_inner"]
    base = 2 * np.pi * centre / p["base_width"]
    length, top = p["overall_rad"] - centre, p["overall_rad"] * max(p["top_width"], 1.2 * base)
    low, high = sorted((p["min_angle"], p["max_angle"]))
    return {
        "Center Rad": centre,
        "Petal Dims": (length, base, top),
        "Seed Size": p["seed_size"],
        "Min Petal Angle": np.radians(low),
        "Max Petal Angle": np.radians(high),
        "Wrinkle": p["wrinkle"],
        "Curl": np.radians(p["curl"]),
    }
