"""The dandelion: the effects of its parameters; tests/contracts/test_adapters.py compares it with Infinigen's own."""

from collections.abc import Iterator

import numpy as np
import pytest

from dipcg.generators import load_generator
from dipcg.mesh import Mesh
from dipcg.workers.pool import BuildPool

# The number of filaments of a seed.
FILAMENTS = 40
DANDELION = load_generator("dandelion")
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(DANDELION.missing), reason="Infinigen is not installed")]


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("dandelion") as pool:
        pool.warm()
        yield pool


def test_a_head_without_seeds_has_no_part_of_that_name(pool):
    assert pool.build(dandelion_with(flower_mode="no_flower")).part_names == ("stem", "core")


def test_the_core_is_at_the_end_of_the_stems_curve(pool):
    params = dandelion_with(flower_mode="no_flower", bezier_end_x=0.5, bezier_end_y=-0.4)
    np.testing.assert_allclose(part(pool.build(params), "core").centre, [0.5, -0.4, 1.0], atol=0.005)


@pytest.mark.parametrize(
    ("bounds", "left"),
    [((0, 0, 0, 0), 1.0), ((1, 1, 0, 0), 0.0), ((1, 0.5, 0, 0), 0.5), ((0.5, 1, 0, 0), 0.5), ((1, 0, 0, 0.5), 0.5)],
)
def test_seeds_are_missing_between_their_bounds(pool, bounds: tuple, left: float):
    """`bounds` are the upper bounds of rows and columns and then their lower bounds."""
    names = ("row_less_than", "col_less_than", "row_great_than", "col_great_than")
    every = dandelion_with(flower_mode="sparse_flower", random_dropout=0.6, flower_num_core_segments=25)
    missing = every | dict(zip(names, map(float, bounds), strict=True))
    most = seeds(pool.build(every | dict.fromkeys(names, 0.0), "light"))
    assert seeds(pool.build(missing, "light")) == pytest.approx(left * most, abs=0.12 * most)


def test_a_light_head_has_every_filament(pool):
    """A filament of a light head is one triangle of several centimetres; without them the head would look bald."""
    light = part(pool.build(dandelion_with(), "light"), "seed")
    a, b, c = np.moveaxis(light.vertices[light.faces], 1, 0)
    longest = np.max([np.linalg.norm(x - y, axis=1) for x, y in ((a, b), (b, c), (c, a))], axis=0)
    shortest = np.min([np.linalg.norm(x - y, axis=1) for x, y in ((a, b), (b, c), (c, a))], axis=0)
    full = part(pool.build(dandelion_with()), "seed")
    assert np.sum((longest > 0.02) & (shortest < 0.003)) >= FILAMENTS * len(full.faces) / 20_720


@pytest.mark.parametrize("detail", ["full", "light"])
@pytest.mark.parametrize("name", ["stem", "core"])
def test_faces_look_outwards(pool, name: str, detail: str):
    mesh = part(pool.build(dandelion_with(), detail), name)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces] - mesh.centre, 1, 0)
    assert np.sum(a * np.cross(b, c)) > 0


def seeds(mesh: Mesh) -> int:
    """The number of seeds of a light mesh."""
    return len(part(mesh, "seed").faces) // 64 if "seed" in mesh.part_names else 0


def part(mesh: Mesh, name: str) -> Mesh:
    faces = mesh.faces[mesh.parts == mesh.part_names.index(name)]
    used, inverse = np.unique(faces, return_inverse=True)
    parts = np.zeros(len(faces), np.uint8)
    return Mesh(mesh.vertices[used], inverse.reshape(-1, 3).astype(np.int32), parts, (name,))


def dandelion_with(**changes: object) -> dict:
    middle = DANDELION.space.decode(np.zeros(len(DANDELION.space)))
    return DANDELION.space.replace(middle, {"flower_mode": "full_flower"} | changes)
