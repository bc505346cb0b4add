"""The basket: compared with Infinigen's own under Blender's exact boolean, and the effects of its parameters."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dipcg.generators import load_generator
from dipcg.mesh import Mesh, make_mesh
from dipcg.metrics import sample_surface
from dipcg.metrics.chamfer import nearest
from dipcg.workers.pool import BuildPool

# Seeds of assets within the published ranges: sharp, rounded, and with 115 bars for holes, which take seconds.
SEEDS = (2, 3, 9)
BASKET = load_generator("basket")
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(BASKET.missing), reason="Infinigen is not installed")]

# This program writes Infinigen's own baskets. The boolean has the exact solver, as the adapter's text says, and Blender
# divides its faces into triangles, because they are not convex.
DIRECT = """
import json, os, sys
import numpy as np
from dipcg.blender.infinigen import clean_blender, find_node, import_infinigen, silence

module = import_infinigen("infinigen.assets.objects.organizer.basket")
inexact, arrays = module.geometry_nodes, {}

def exact(wrangler, **params):
    inexact(wrangler, **params)
    find_node(wrangler.node_group, "MESH_BOOLEAN").solver = "EXACT"

module.geometry_nodes = exact
for seed in map(int, sys.argv[2:]):
    clean_blender()
    np.random.seed(seed)
    with silence():
        factory = module.BasketBaseFactory(seed)
        factory.params = factory.get_asset_params()
        mesh = factory.create_asset().data
    mesh.calc_loop_triangles()
    vertices = np.array([vertex.co for vertex in mesh.vertices])
    faces = np.array([triangle.vertices for triangle in mesh.loop_triangles])
    params = json.dumps({name: np.asarray(value).item() for name, value in factory.params.items()})
    arrays |= {f"{seed}.vertices": vertices, f"{seed}.faces": faces, f"{seed}.params": params}
np.savez(sys.argv[1], **arrays)
os._exit(0)
"""


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("basket") as pool:
        pool.warm()
        yield pool


def test_the_basket_equals_infinigens_own(pool, tmp_path: Path):
    subprocess.run([sys.executable, "-c", DIRECT, str(tmp_path / "own.npz"), *map(str, SEEDS)], check=True)
    own = np.load(tmp_path / "own.npz")
    for seed in SEEDS:
        theirs = make_mesh(own[f"{seed}.vertices"], own[f"{seed}.faces"])
        params = BASKET.space.validate(params_of(json.loads(str(own[f"{seed}.params"]))))
        ours = pool.build(params)
        np.testing.assert_allclose(ours.bounds, theirs.bounds, atol=1e-6)
        assert area(ours) == pytest.approx(area(theirs), rel=1e-5)
        assert volume(ours) == pytest.approx(volume(theirs), rel=1e-5)
        assert distance(ours, theirs) < 0.01
        assert distance(pool.build(params, "light"), theirs) < 0.01


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
    return {name: own[name] for name in BASKET.space.names} | read


def distance(a: Mesh, b: Mesh) -> float:
    """The Hausdorff distance of the surfaces, in longest sides, from samples of points."""
    rng = np.random.default_rng(0)
    first, second = (sample_surface(mesh, 100_000, rng) / a.side for mesh in (a, b))
    return max(nearest(first[:4000], second).max(), nearest(second[:4000], first).max())


def area(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2


def volume(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces].astype(float), 1, 0)
    return float(np.sum(a * np.cross(b, c))) / 6


@pytest.mark.parametrize("detail", ["full", "light"])
def test_a_sharp_basket_has_the_size_of_its_parameters_and_stands_on_the_floor(pool, detail: str):
    mesh = pool.build(basket_with(depth=0.2, width=0.5, height=0.3, has_holes=True), detail)
    np.testing.assert_allclose(mesh.bounds, [[-0.1, -0.25, 0], [0.1, 0.25, 0.3]], atol=1e-6)


@pytest.mark.parametrize("level", [0, 3])
def test_the_basket_is_open_at_the_top_alone(pool, level: int):
    thin, thick = (pool.build(basket_with(frame_sub_level=level, thickness=t)) for t in (0.002, 0.004))
    # The volume is that of walls and bottom alone.
    assert volume(thick) == pytest.approx(2 * volume(thin), rel=0.02)
    assert genus(thin) == 0


def test_every_gap_is_a_hole(pool):
    """A height of 0.4 m minus the edges has 10 rows of holes at a distance of 30 mm; 0.2 and 0.3 m have 3 and 7."""
    size = {"depth": 0.2, "width": 0.3, "height": 0.4}
    holes = {"has_holes": True, "hole_size": 0.02, "hole_gap_size": 0.5, "hole_edge_gap": 0.09}
    assert genus(pool.build(basket_with(**size, **holes))) == 2 * 10 * (3 + 7)
    assert genus(pool.build(basket_with(**size, **holes | {"hole_gap_size": 2.0}))) == 2 * 5 * (1 + 3)
    assert genus(pool.build(basket_with(**size, **holes, has_handle=True, handle_dist_to_top=0.08))) > 0


def test_handles_make_two_openings(pool):
    assert genus(pool.build(basket_with(has_handle=True, handle_sub_level=2))) == 2


def test_low_baskets_have_holes(pool):
    low = basket_with(height=0.08, has_holes=True, hole_edge_gap=0.04, hole_size=0.01, hole_gap_size=1.0)
    assert genus(pool.build(low)) > 0


def genus(mesh: Mesh) -> int:
    """The number of holes through a closed surface, by Euler's formula."""
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all(), "it is not closed"
    return 1 - (len(np.unique(mesh.faces)) - len(edges) // 2 + len(mesh.faces)) // 2


def basket_with(**changes: object) -> dict:
    plain = {"frame_sub_level": 0, "has_handle": False, "has_holes": False}
    return BASKET.space.replace(BASKET.space.decode(np.zeros(len(BASKET.space))), plain | changes)
