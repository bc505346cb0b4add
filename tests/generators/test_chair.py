"""The chair: compared with Infinigen's own, and the effects of its parameters."""

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

CHAIR = load_generator("chair")
# Seeds of assets within the published ranges; see `test_the_assets_differ_in_their_parts`.
SEEDS = (2, 3, 11, 13, 19)
pytestmark = [pytest.mark.blender, pytest.mark.skipif(bool(CHAIR.missing), reason="Infinigen is not installed")]

# This program writes Infinigen's own chairs. The middle of the range replaces the draws of a build, as in the adapter.
DIRECT = """
import json, os, sys
import numpy as np
from dipcg.blender.infinigen import clean_blender, import_infinigen, middle, read_piece, replaced, silence

module = import_infinigen("infinigen.assets.objects.seating.chairs.chair")
arrays = {}
for seed in map(int, sys.argv[2:]):
    clean_blender()
    with silence():
        factory = module.ChairFactory(seed)
        factory.seat_mid_x = (factory.seat_back + factory.seat_mid * (1 - factory.seat_back) + 1) / 2
        with replaced(module, uniform=middle):
            _, vertices, faces = read_piece("chair", factory.create_asset())
    types = (bool, int, float, str, tuple, list, np.ndarray, np.generic)
    plain = {name: value for name, value in vars(factory).items() if isinstance(value, types)}
    own = json.dumps(plain, default=lambda value: value.tolist())
    arrays |= {f"{seed}.vertices": vertices, f"{seed}.faces": faces, f"{seed}.own": own}
np.savez(sys.argv[1], **arrays)
os._exit(0)
"""


@pytest.fixture(scope="module")
def pool() -> Iterator[BuildPool]:
    with BuildPool("chair") as pool:
        pool.warm()
        yield pool


@pytest.fixture(scope="module")
def assets(tmp_path_factory) -> list[tuple[Mesh, dict]]:
    """Infinigen's own chairs, turned so that their front is at -Y, and our parameters for them."""
    file: Path = tmp_path_factory.mktemp("chairs") / "own.npz"
    subprocess.run([sys.executable, "-c", DIRECT, str(file), *map(str, SEEDS)], check=True)
    own = np.load(file)
    meshes = [make_mesh(own[f"{s}.vertices"][:, [1, 0, 2]] * [1, -1, 1], own[f"{s}.faces"]) for s in SEEDS]
    params = [CHAIR.space.validate(params_of(json.loads(str(own[f"{s}.own"])))) for s in SEEDS]
    return list(zip(meshes, params, strict=True))


def test_the_chair_equals_infinigens_own(pool, assets):
    for theirs, params in assets:
        ours = pool.build(params)
        np.testing.assert_allclose(ours.bounds, theirs.bounds, atol=1e-4)
        assert distance(ours, theirs) < 0.01, params


def test_the_assets_differ_in_their_parts(assets):
    for name in ("back_type", "is_leg_round", "has_arm", "has_leg_x_bar", "has_leg_y_bar", "is_seat_subsurf"):
        assert len({params[name] for _, params in assets}) > 1, name


def test_the_chair_has_the_height_and_the_width_of_its_parameters(pool):
    params = chair_with(leg_height=0.5, back_height=0.4, width=0.6, leg_type="vertical", back_type="whole")
    mesh = pool.build(params, "light")
    assert mesh.bounds[0, 2] == pytest.approx(-0.5, abs=0.002)
    assert 0.4 < mesh.bounds[1, 2] < 0.45, "the top of a whole back is arched"
    assert np.ptp(mesh.bounds[:, 0]) == pytest.approx(0.6, abs=0.03)


@pytest.mark.parametrize("switch", ["has_arm", "has_leg_x_bar", "has_leg_y_bar"])
def test_switches_add_a_part_on_both_sides(pool, switch):
    part = "arm" if switch == "has_arm" else "bar"
    without, with_it = (pool.build(chair_with(**{switch: on}), "light") for on in (False, True))
    assert part not in without.part_names
    added = with_it.vertices[np.unique(with_it.faces[with_it.parts == with_it.part_names.index(part)])]
    axis = 1 if switch == "has_leg_x_bar" else 0
    offsets = added[:, axis] - with_it.centre[axis]
    assert offsets.min() < -0.05
    assert offsets.max() > 0.05


def distance(a: Mesh, b: Mesh) -> float:
    """The Hausdorff distance of the surfaces, in longest sides, from samples of points."""
    rng = np.random.default_rng(0)
    first, second = (sample_surface(mesh, 100_000, rng) / a.side for mesh in (a, b))
    return max(nearest(first[:4000], second).max(), nearest(second[:4000], first).max())


def chair_with(**changes: object) -> dict:
    plain = {"has_arm": False, "has_leg_x_bar": False, "has_leg_y_bar": False}
    return CHAIR.space.replace(CHAIR.space.decode(np.zeros(len(CHAIR.space))), plain | changes)


def params_of(own: dict) -> dict:
    """Our parameters from the attributes of the factory; one without an effect may lie outside the published range."""
    width, size = own["width"], own["size"]
    params = {p.name: p.inactive for p in CHAIR.space}
    params |= {name: own[name] for name in CHAIR.space.names if name in own and not name.startswith("arm")}
    params |= {
        "bevel_width": round(own["bevel_width"] / own["thickness"], 6),
        "leg_offset_bar0": sum(own["leg_offset_bar"]) / 2,
        "leg_offset_bar1": sum(own["leg_offset_bar"]) / 2,
        "leg_x_offset": own["leg_x_offset"] / width,
        "leg_y_offset0": own["leg_y_offset"][0] / size,
        "leg_y_offset1": own["leg_y_offset"][1] / size,
        "back_x_offset": own["back_x_offset"] / width,
        "back_y_offset": own["back_y_offset"] / size,
    }
    arm = {
        "arm_thickness": own["arm_thickness"],
        "arm_height": own["arm_height"] / own["arm_thickness"],
        "arm_y": own["arm_y"] / size,
        "arm_z": own["arm_z"] / own["back_height"],
        **{f"arm_mid{i}": own["arm_mid"][i] for i in range(3)},
        **{f"arm_profile{i}": own["arm_profile"][i] for i in range(2)},
    }
    return params | (arm if own["has_arm"] else {}) | _back(own["back_type"], own["back_profile"])


def _back(back_type: str, spans: list) -> dict:
    if back_type == "partial":
        return {"back_profile_partial": spans[0][0]}
    if back_type == "vertical-bar":
        return {"back_profile_vertical": spans[0][0]}
    if back_type == "whole":
        return {}
    tops = np.array([top for _, top in spans])
    lowest = (spans[0][0] - (ratio := _ratio(spans)) * tops[0]) / (1 - ratio)
    slats = np.diff((tops - lowest) / (1 - lowest), prepend=0)
    return {
        "back_profile_horizontal_ncuts": len(spans),
        "back_profile_horizontal_ratio": ratio,
        "back_profile_horizontal_lowest": lowest,
        **{f"back_profile_horizontal_locs{i}": slat for i, slat in enumerate(slats / slats.min())},
    }


def _ratio(spans: list) -> float:
    """The gap below a slat as a share of slat and gap, from the second slat, whose gap begins where the first ends."""
    return (spans[1][0] - spans[0][1]) / (spans[1][1] - spans[0][1])
