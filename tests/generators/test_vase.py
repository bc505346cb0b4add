"""The vase: compared with Infinigen's own, and the effects of its parameters."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dipcg.generators import load_generator
from dipcg.mesh import make_mesh
from dipcg.workers.pool import BuildPool

# Seeds of assets within the published ranges, smooth and fluted.
SEEDS = (3, 12, 15)
VASE = load_generator("vase")
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(VASE.missing), reason="Infinigen is not installed")]

# This program writes Infinigen's own vases. The factory draws the size before it sets its own seed, so the program sets
# a seed before.
DIRECT = """
import json, os, sys
import numpy as np
from dipcg.blender.infinigen import clean_blender, import_infinigen, read_piece, silence

module = import_infinigen("infinigen.assets.objects.table_decorations.vase")
arrays = {}
for seed in map(int, sys.argv[2:]):
    clean_blender()
    np.random.seed(seed)
    with silence():
        factory = module.VaseFactory(seed)
        _, vertices, faces = read_piece("vase", factory.create_asset())
    params = {name: value for name, value in factory.params.items() if name != "Material"}
    arrays |= {f"{seed}.vertices": vertices, f"{seed}.faces": faces, f"{seed}.params": json.dumps(params, default=int)}
np.savez(sys.argv[1], **arrays)
os._exit(0)
"""


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("vase") as pool:
        pool.warm()
        yield pool


def test_the_vase_equals_infinigens_own(pool, tmp_path: Path):
    subprocess.run([sys.executable, "-c", DIRECT, str(tmp_path / "own.npz"), *map(str, SEEDS)], check=True)
    own = np.load(tmp_path / "own.npz")
    for seed in SEEDS:
        theirs = make_mesh(own[f"{seed}.vertices"], own[f"{seed}.faces"])
        ours = pool.build(VASE.space.validate(params_of(json.loads(str(own[f"{seed}.params"])))))
        turned_back = np.stack([-ours.vertices[:, 1], ours.vertices[:, 0], ours.vertices[:, 2]], axis=1)
        np.testing.assert_allclose(turned_back, theirs.vertices, atol=1e-5)
        np.testing.assert_array_equal(ours.faces, theirs.faces)


def params_of(own: dict) -> dict:
    """Our parameters from those of the factory."""
    neck = own["Neck Scale"]
    return {
        "dimension_x": own["Diameter"],
        "dimension_z": own["Height"],
        "neck_scale": neck,
        "profile_inner_radius": own["Profile Inner Radius"],
        "profile_star_points": own["Profile Star Points"],
        "top_scale": own["Top Scale"] / neck,
        "neck_mid_position": own["Neck Mid Position"],
        "neck_position": own["Neck Position"] - 0.5 * neck - 0.5,
        "shoulder_position": own["Shoulder Position"],
        "shoulder_thickness": own["Shoulder Thickness"],
        "foot_scale": own["Foot Scale"],
        "foot_height": own["Foot Height"],
    }


@pytest.mark.parametrize("detail", ["full", "light"])
@pytest.mark.parametrize("height", [0.2, 0.5, 0.8])
def test_the_vase_has_the_height_and_the_width_of_its_parameters(pool, height: float, detail: str):
    params = vase_with(dimension_z=height, dimension_x=0.4 * height, profile_inner_radius=1.0, neck_position=-0.1)
    low, high = pool.build(params, detail).bounds
    assert high[2] - low[2] == pytest.approx(height, rel=0.03)
    # The smooth outline bulges beyond the points that it is made from.
    assert high[0] - low[0] == pytest.approx(2 * params["dimension_x"], rel=0.08)


@pytest.mark.parametrize("points", [3, 4, 5])
def test_a_star_has_the_given_number_of_points(pool, points: int):
    vertices = pool.build(vase_with(profile_star_points=points, profile_inner_radius=0.8)).vertices
    angle, radius = np.arctan2(vertices[:, 1], vertices[:, 0]), np.hypot(vertices[:, 0], vertices[:, 1])
    widest = np.abs(vertices[:, 2] - vertices[radius.argmax(), 2]) < 0.01
    waves = [np.abs(np.sum(radius[widest] * np.exp(1j * corners * angle[widest]))) for corners in range(2, 8)]
    assert np.argmax(waves) + 2 == points


def vase_with(**changes: object) -> dict:
    return VASE.space.replace(VASE.space.decode(np.zeros(len(VASE.space))), changes)
