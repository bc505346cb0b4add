"""The table: the effects of its parameters; tests/contracts/test_adapters.py compares it with Infinigen's own."""

from collections.abc import Iterator

import numpy as np
import pytest
import trimesh

from dipcg.blender.caps import recapped
from dipcg.generators import load_generator
from dipcg.mesh import Mesh, Solid
from dipcg.mesh.simplify import weld
from dipcg.workers.pool import BuildPool

TABLE = load_generator("table")
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(TABLE.missing), reason="Infinigen is not installed")]


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("table") as pool:
        pool.warm()
        yield pool


@pytest.mark.parametrize(
    ("style", "number", "legs"),
    [("single-stand", 1, 1), ("single-stand", 2, 2), ("single-stand", 4, 4), ("square", 1, 2), ("straight", 1, 4)],
)
def test_the_style_decides_the_number_of_legs(pool, style: str, number: int, legs: int):
    mesh = pool.build(table_with(leg_style=style, leg_number=number, leg_diameter=0.1))
    assert components(mesh, "leg") == legs


@pytest.mark.parametrize(("increment", "stretchers"), [(0, 0), (1, 4), (2, 2)])
def test_stretchers_join_neighbours_or_diagonals(pool, increment: int, stretchers: int):
    mesh = pool.build(table_with(leg_style="straight", strecher_increament=increment))
    assert components(mesh, "stretcher") == stretchers


@pytest.mark.parametrize("style", ["single-stand", "square", "straight"])
@pytest.mark.parametrize("leg_height", [0.6, 1.0, 2.0])
def test_the_table_stands_on_the_floor(pool, style: str, leg_height: float):
    params = table_with(leg_style=style, leg_height=leg_height, bottom_scale=1.0)
    mesh = pool.build(params)
    below = params["dimension_z"] - params["top_thickness"]
    # The lower bar of a square frame lies halfway in the floor.
    assert mesh.bounds[0, 2] == pytest.approx(0, abs=0.02)
    assert mesh.bounds[1, 2] == pytest.approx(leg_height * below + params["top_thickness"], abs=1e-4)


@pytest.mark.parametrize("style", ["single-stand", "square", "straight"])
def test_no_leg_comes_through_the_top(pool, style: str):
    mesh = pool.build(table_with(leg_style=style, leg_diameter=1.0, top_thickness=0.02, bottom_scale=1.3))
    legs = mesh.vertices[np.unique(mesh.faces[mesh.parts == mesh.part_names.index("leg")])]
    assert legs[:, 2].max() < mesh.bounds[1, 2] - 0.001


def table_with(**changes: object) -> dict:
    return TABLE.space.replace(TABLE.space.decode(np.zeros(len(TABLE.space))), changes)


def components(mesh: Mesh, part: str) -> int:
    """The number of connected components of a part."""
    if part not in mesh.part_names:
        return 0
    welded = weld(mesh)
    faces = welded.faces[welded.parts == mesh.part_names.index(part)]
    return len(trimesh.graph.connected_components(trimesh.graph.face_adjacency(faces), nodes=np.arange(len(faces))))


@pytest.mark.parametrize("detail", ["light", "full"])
def test_tables_are_made_of_closed_solids(pool, detail):
    many = [TABLE.space.sample(np.random.default_rng(seed)) for seed in range(12)]
    # In this table some vertices of the fill and of the rim coincide.
    round_corners = {"ngon": 4, "top_profile_fillet_ratio": 0.5037310990793887}
    size = {"dimension_x": 1.3175588940987344, "dimension_y": 1.995527584840894}
    many.append(TABLE.space.replace(many[0], round_corners | size))
    for params, mesh in zip(many, pool.map(many, detail), strict=True):
        surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        surface.merge_vertices(digits_vertex=7)
        surface.update_faces((surface.faces != np.roll(surface.faces, 1, axis=1)).all(1))
        _, uses = np.unique(surface.edges_sorted, axis=0, return_counts=True)
        assert uses.min() == 2, params
        assert surface.is_watertight or detail == "light", "simplification may join two solids along an edge"
        assert all(solid.volume > 0 for solid in surface.split()), "faces look outwards"


def test_caps_get_the_vertices_of_the_rim():
    """The lids of this prism have vertices of their own, halfway between those of its wall."""
    turns = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring, between = (np.c_[np.cos(t), np.sin(t)] for t in (turns, turns + np.pi / 12))
    low, high = (np.c_[ring, np.full(12, z)] for z in (0.0, 1.0))
    here, there = np.arange(12), np.roll(np.arange(12), -1)
    wall = np.vstack([np.c_[here, there, there + 12], np.c_[here, there + 12, here + 12]])
    lids = [np.c_[between, np.full(12, z)] for z in (0.0, 1.0)]
    fans = [np.c_[np.zeros(10, int), np.arange(1, 11), np.arange(2, 12)] + 24 + 12 * i for i in (0, 1)]
    vertices = np.vstack([low, high, *lids]).astype(np.float32)
    faces = np.vstack([wall, fans[0][:, ::-1], fans[1]]).astype(np.int32)
    assert not trimesh.Trimesh(vertices, faces, process=False).is_watertight
    _, vertices, faces, *_ = recapped(Solid("top", vertices, faces))
    closed = trimesh.Trimesh(vertices, faces, process=False)
    assert closed.is_watertight
    assert closed.volume == pytest.approx(12 / 2 * np.sin(np.pi / 6), rel=1e-5)
