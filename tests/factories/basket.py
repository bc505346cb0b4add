"""Infinigen's baskets. The boolean has Blender's exact solver, as the adapter's text says."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from dipcg.blender.infinigen import find_node, import_infinigen
from dipcg.generators import load_generator
from dipcg.mesh import Mesh

# Seeds of assets within the published ranges: sharp, rounded, and with 115 bars for holes, which take seconds.
KEYS = (2, 3, 9)
ATOL, LIGHT_TOLERANCE = 1e-6, 0.01


@cache
def _module() -> Any:
    module = import_infinigen("infinigen.assets.objects.organizer.basket")
    inexact = module.geometry_nodes

    def exact(wrangler: Any, **params: Any) -> None:
        inexact(wrangler, **params)
        find_node(wrangler.node_group, "MESH_BOOLEAN").solver = "EXACT"

    module.geometry_nodes = exact
    return module


def make(key: int) -> tuple[np.ndarray, np.ndarray, dict]:
    module = _module()
    np.random.seed(key)  # noqa: NPY002
    factory = module.BasketBaseFactory(key)
    factory.params = factory.get_asset_params()
    mesh = factory.create_asset().data
    # Blender divides the faces of a boolean into triangles, because they are not convex.
    mesh.calc_loop_triangles()
    vertices = np.array([vertex.co for vertex in mesh.vertices])
    return vertices, np.array([triangle.vertices for triangle in mesh.loop_triangles]), factory.params


def params_of(own: dict) -> dict:
    """Our parameters from those of the factory; one without an effect may lie outside the published range."""
    height, hole = own["height"], own["hole_size"]
    read = {
        "handle_depth": own["handle_depth"] / own["depth"],
        "handle_height": own["handle_height"] / height,
        "handle_dist_to_top": (own["handle_dist_to_top"] - own["handle_height"] / 2) / height,
        "hole_gap_size": own["hole_gap_size"] / hole,
        "hole_size": hole if own["has_holes"] else max(hole, 0.007),
    }
    return {name: own[name] for name in load_generator("basket").space.names} | read


def check(ours: Mesh, theirs: Mesh) -> None:
    """The area and the volume are equal."""
    assert _area(ours) == pytest.approx(_area(theirs), rel=1e-5)
    assert volume(ours) == pytest.approx(volume(theirs), rel=1e-5)


def volume(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return float(np.sum(a * np.cross(b, c))) / 6


def _area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2
