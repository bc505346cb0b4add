"""Files of strangers (`../shared/blends`) and Blenders that are not ours; each is skipped where it is not there."""

import os
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from dipcg.generators import load_generator
from dipcg.importing.blend import Options, import_blend
from dipcg.workers.pool import BuildPool

LAMP = Path(__file__).parents[2] / "examples" / "lamp.blend"
STRANGERS = Path(__file__).parents[3] / "shared" / "blends"
# A Python that has a newer bpy, as `make newer-blender` installs it.
NEWER = os.environ.get("DIPCG_NEWER_BLENDER", str(Path(__file__).parents[2] / ".newer-blender" / "bin" / "python"))
OLDER = shutil.which("blender") or ""
UNAIDED = {
    "brackets": "wdith height thickness angle",
    "low_poly_tree": "trunk_height trunk_radius trunk_taper trunk_distortion trunk_bump canopy_radius",
    "ptgn_chair": "legs_type has_back has_arms arm_height seat_width",
    "ptgn_table": "width top_shape legs_type has_mid_board",
    "seven_segments": "segment_length segment_thickness digit",
    "simple_chair": "back_height seat_thickness leg_length",
}

pytestmark = pytest.mark.blender
strangers = pytest.mark.skipif(not STRANGERS.is_dir(), reason="../shared/blends is not there")
ours = pytest.mark.skipif(find_spec("bpy") is None, reason="bpy not installed")
newer = pytest.mark.skipif(not Path(NEWER).exists(), reason="no newer Blender; `make newer-blender` installs one")
older = pytest.mark.skipif(not OLDER, reason="no Blender of the system; Debian has the package blender")


@pytest.fixture
def stranger(tmp_path):
    return lambda name: Path(shutil.copy(STRANGERS / f"{name}.blend", tmp_path / f"{name}.blend"))


def usable_meshes(toml: Path, count: int = 4) -> int:
    """How many of some random light meshes, as a data set has them, can be built."""
    rng, space = np.random.default_rng(1), load_generator(str(toml)).space
    with BuildPool(str(toml)) as pool:
        return sum(not isinstance(mesh, Exception) for mesh in pool.map(space.sample(rng) for _ in range(count)))


@ours
@strangers
@pytest.mark.parametrize("name", UNAIDED)
def test_a_strangers_file_gets_in_unaided(stranger, name):
    made = import_blend(stranger(name))
    assert set(UNAIDED[name].split()) <= set(made.parameters)
    assert usable_meshes(made.path) == 4


@ours
@strangers
def test_conditions_are_found_by_trying(stranger):
    space = load_generator(str(import_blend(stranger("ptgn_chair")).path)).space
    assert space["back_height"].when == {"has_back": (True,)}
    assert space["arm_height"].when == {"has_arms": (True,)}
    assert space["middle_offset"].when == {"legs_type": (0,), "has_middle_support": (True,)}
    assert space["seat_width"].when == {}
    assert space["legs_type"].options == (0, 1)


@ours
@strangers
def test_a_file_of_a_newer_blender_is_refused_with_its_version(stranger):
    with pytest.raises(ValueError, match=r"It was saved by Blender 5\.1; give a Blender that is as new with --blender"):
        import_blend(stranger("clock_blender5"))


@newer
def test_a_newer_blender_builds(tmp_path):
    check_other_blender(tmp_path, NEWER)


@newer
def test_a_node_that_reads_another_file_is_refused(tmp_path):
    """With Import Text, whoever sends a file would read any file of the server as a mesh of its letters."""
    chain = ("ImportText", "StringToCurves", "RealizeInstances", "FillCurve")
    made = saved_by_newer(
        tmp_path / "reader.blend",
        chain,
        f"""
nodes[0].inputs[0].default_value = {str(LAMP.with_name("fluted_vase.scad"))!r}
tree.links.new(tree.nodes.new("NodeGroupInput").outputs["Size"], nodes[1].inputs["Size"])
""",
    )
    with pytest.raises(ValueError, match=r"has nodes that read other files: Import Text\."):
        import_blend(made, Options(blender=NEWER))


@newer
def test_a_bake_that_is_not_packed_is_not_read_from_the_disk(tmp_path):
    """Blender 4.3 and newer look into the folder also where a bake is to be packed."""
    bakes = tmp_path / "bakes"
    bakes.mkdir()
    place = f"modifier.bake_directory, modifier.bake_target = {str(bakes)!r}, 'PACKED'"
    made = saved_by_newer(tmp_path / "baked.blend", ("MeshCube", "Bake"), place)
    with pytest.raises(ValueError, match=r"'Cube' in .* needs .*bakes\. In Blender, make it local"):
        import_blend(made, Options(blender=NEWER))


@older
@strangers
def test_the_older_blender_of_the_system_builds(stranger):
    made = import_blend(stranger("brackets"), Options(blender=OLDER))
    assert f'blender = "{OLDER}"' in made.path.read_text()
    assert usable_meshes(made.path) == 4


def saved_by_newer(path: Path, kinds: tuple[str, ...], change: str) -> Path:
    """A file of the newer Blender: a cube whose nodes, of these kinds, stand in a row, with a change before saving."""
    program = f"""
import bpy
tree = bpy.data.node_groups.new("made", "GeometryNodeTree")
tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
tree.interface.new_socket("Size", in_out="INPUT", socket_type="NodeSocketFloat")
nodes = [tree.nodes.new("GeometryNode" + kind) for kind in {kinds!r}] + [tree.nodes.new("NodeGroupOutput")]
for one, other in zip(nodes, nodes[1:]):
    tree.links.new(one.outputs[0], other.inputs[0])
modifier = bpy.context.object.modifiers.new("made", "NODES")
modifier.node_group = tree
{change}
bpy.ops.wm.save_as_mainfile(filepath={str(path)!r})
"""
    subprocess.run([NEWER, "-c", program], check=True, capture_output=True)
    return path


def check_other_blender(folder: Path, program: str) -> None:
    made = import_blend(Path(shutil.copy(LAMP, folder / "lamp.blend")), Options(blender=program))
    assert f'blender = "{program}"' in made.path.read_text()
    assert load_generator(str(made.path)).space["shade"].options == ("Cone", "Dome", "Globe")
    assert usable_meshes(made.path) == 4


@pytest.mark.parametrize("given", ["no-such-blender", "/bin/true", "/bin/sh"])
def test_a_program_that_is_no_blender_gets_a_sentence(tmp_path, given):
    with pytest.raises(ValueError, match=r"There is no program|is neither a Blender nor a Python that has bpy\."):
        import_blend(Path(shutil.copy(LAMP, tmp_path / "lamp.blend")), Options(blender=given))
