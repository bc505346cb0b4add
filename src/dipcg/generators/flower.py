"""Infinigen's flower with the paper's 9 parameters.

A thin adapter: Infinigen's function makes the node graph once for each part in each process, and a build sets its
inputs. The first petal points to +X and each further one is a radian on, where the factory turns the whole at random;
noise, wrinkles and seeds have fixed places in the graph. What may surprise:

- There are 1.2 times `base_width` petals, rounded down, so that they overlap by a fifth of the centre's round.
- `top_width` is no less than 1.2 times the width of the base in metres, and the graph lets a petal widen by a metre.
- The published pair of angles is sorted, so that two sets of parameters gave one flower. Here too the smaller is that
  of the first petals, but where `min_angle` is the larger the flower is mirrored: its petals go around the other way.
- Seeds are spikes, on the lower side of the bed as well, and up to a million faces: the light ones are fewer and wider
  where they would be more than can be told apart.

Sources: Infinigen (Raistrick et al. 2023) for the factory, DI-PCG's published parameters for list and ranges.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from dipcg.blender.infinigen import (
    Piece,
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
from dipcg.mesh import Mesh, join
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
views = ViewRange(azimuth_deg=(-30, 30), elevation_deg=(5, 75))  # a radian on, the next petal takes the place of one
mirrors = {"min_angle": "max_angle", "max_angle": "min_angle"}
needs = ("infinigen", "bpy")

_MANY, _MOST = 0.075, 0.04  # seeds per radius of the bed: below these they are some 300, some 1,000
_SQUARE = 1.09  # what a seed of 4 sides is wider than one of 6 of the same girth
_MODULE = "infinigen.assets.objects.grassland.flower"


@functools.cache
def prepare() -> dict[str, Any]:
    """Import Infinigen and make the graphs that every build of this process sets up anew: one for each part."""
    module = import_infinigen(_MODULE)
    with silence():
        return {part: graph_object(_graph(module, link)) for part, link in (("petal", 0), ("centre", 1))}


def _graph(module: Any, part: int) -> Any:
    """The flower's graph with one of the two parts that it joins."""
    graph = new_graph(module.geo_flower, {}, petal_material=None, center_material=None)
    joined = find_node(graph, "SET_SHADE_SMOOTH").inputs[0].links[0].from_node
    graph.links.remove(joined.inputs[0].links[1 - part])
    return graph


def build(params: Params) -> Mesh:
    return _build(params, light=False)


def build_light(params: Params) -> Mesh:
    """Seeds with fewer corners; those that would be too many are fewer and wider, and as high."""
    return _build(params, light=True)


def _build(p: Any, light: bool) -> Mesh:
    inputs = _inputs(p)
    with silence():
        pieces = [_petals(inputs), _centre(inputs, light)]
    return join([_mirrored(piece) for piece in pieces] if p["min_angle"] > p["max_angle"] else pieces)


def _petals(inputs: dict[str, Any]) -> Piece:
    obj = prepare()["petal"]
    set_inputs(obj, inputs)
    return read_piece("petal", evaluated(obj))


def _centre(inputs: dict[str, Any], light: bool) -> Piece:
    """The seeds on their bed; the factory's own are 10 times as long as their radius and 1.5 times as far apart."""
    obj, size, bed = prepare()["centre"], inputs["Seed Size"], inputs["Center Rad"]
    coarse = light and size < _MANY * bed
    spaced = max(size, _MOST * bed) if coarse else size
    radius = _SQUARE * spaced if coarse else size
    set_inputs(obj, inputs | {"Seed Size": radius})
    seed = find_node(graph_of(obj), "nodegroup_plant_seed")
    set_node(seed, {"U": 3, "V": 4} if coarse else {"U": 6, "V": 6})
    points = find_node(graph_of(obj), "DISTRIBUTE_POINTS_ON_FACES")
    _before(_before(seed, "Dimensions"), "X").inputs[1].default_value = 10 * size / radius
    _before(points, "Distance Min").inputs[1].default_value = 1.5 * spaced / radius
    return read_piece("centre", evaluated(obj))


def _mirrored(piece: Piece) -> Piece:
    part, vertices, faces = piece
    return part, vertices * np.array([-1, 1, 1], np.float32), faces[:, ::-1]


def _before(node: Any, name: str) -> Any:
    """The node that gives an input its value."""
    return node.inputs[name].links[0].from_node


def _inputs(p: Any) -> dict[str, Any]:
    """Inputs of the graph, in its units, from the parameters in theirs."""
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
