"""The flower: compared with Infinigen's own, and the effects of its parameters."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dipcg.generators import load_generator
from dipcg.mesh import Mesh, make_mesh
from dipcg.metrics import chamfer, surface_points
from dipcg.workers.pool import BuildPool

# Seeds of assets within the published ranges; most others have more petals.
SEEDS = (16, 48, 66)
FLOWER = load_generator("flower")
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(FLOWER.missing), reason="Infinigen is not installed")]

# This program writes Infinigen's own flowers. An asset mixes its own draw with one of its species, and only the inputs
# of the graph show the result. The factory also turns the flower at random; the mesh is read without this turn.
DIRECT = """
import json, os, sys
import numpy as np
from dipcg.blender.infinigen import clean_blender, import_infinigen, read_piece, replaced, silence

module = import_infinigen("infinigen.assets.objects.grassland.flower")
set_inputs = module.butil.set_geomod_inputs
arrays, params = {}, {}

def record_inputs(modifier, inputs):
    params.update({name: np.asarray(value).tolist() for name, value in inputs.items()})
    set_inputs(modifier, inputs)

for seed in map(int, sys.argv[2:]):
    clean_blender()
    np.random.seed(seed)
    with silence(), replaced(module.butil, set_geomod_inputs=record_inputs):
        asset = module.FlowerFactory(seed, rad=1.0).create_asset()
    asset.rotation_euler.z = 0
    _, vertices, faces = read_piece("flower", asset)
    arrays |= {f"{seed}.vertices": vertices, f"{seed}.faces": faces, f"{seed}.params": json.dumps(params)}
np.savez(sys.argv[1], **arrays)
os._exit(0)
"""


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("flower") as pool:
        pool.warm()
        yield pool


def test_the_flower_equals_infinigens_own(pool, tmp_path: Path):
    subprocess.run([sys.executable, "-c", DIRECT, str(tmp_path / "own.npz"), *map(str, SEEDS)], check=True)
    own = np.load(tmp_path / "own.npz")
    for seed in SEEDS:
        theirs = make_mesh(own[f"{seed}.vertices"], own[f"{seed}.faces"])
        ours = pool.build(FLOWER.space.validate(params_of(json.loads(str(own[f"{seed}.params"])))))
        assert len(ours.vertices) == len(theirs.vertices)
        np.testing.assert_allclose(ours.bounds, theirs.bounds, atol=1e-4)
        assert distance(ours, theirs) < 0.01, seed


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


def distance(a: Mesh, b: Mesh) -> float:
    """The chamfer distance of the surfaces, minus that of two samples of the same surface."""
    points = [surface_points(mesh, 8000, np.random.default_rng(i)) for i, mesh in enumerate((a, b, a))]
    return chamfer.measure(points[0], points[1]) - chamfer.measure(points[0], points[2])


@pytest.mark.parametrize("base_width", [4.5, 9.0, 15.5])
def test_a_flower_has_a_fifth_more_petals_than_fit_side_by_side(pool, base_width: float):
    mesh = pool.build(flower_with(base_width=base_width))
    faces = (mesh.parts == mesh.part_names.index("petal")).sum()
    assert faces / (15 * 16 * 2) == int(1.2 * base_width)


def test_exchanged_angles_give_the_mirror_image(pool):
    one, other = (pool.build(flower_with(min_angle=a, max_angle=b)) for a, b in ((0.0, 70.0), (70.0, 0.0)))
    np.testing.assert_array_equal(other.vertices, one.vertices * [-1, 1, 1])


def test_the_centre_has_its_share_of_the_radius(pool):
    mesh = pool.build(flower_with(overall_rad=1.0, pct_inner=0.4, seed_size=0.005))
    centre = mesh.vertices[np.unique(mesh.faces[mesh.parts == mesh.part_names.index("centre")])]
    assert np.hypot(centre[:, 0], centre[:, 1]).max() == pytest.approx(0.4, abs=0.01)


def test_light_seeds_are_as_high_and_far_fewer(pool):
    params = flower_with(overall_rad=1.3, pct_inner=0.5, seed_size=0.005)
    full, light = pool.build(params), pool.build(params, "light")
    assert len(light.faces) < 0.05 * len(full.faces)
    assert distance(full, light) < 0.01


def flower_with(**changes: object) -> dict:
    return FLOWER.space.replace(FLOWER.space.decode(np.zeros(len(FLOWER.space))), changes)
