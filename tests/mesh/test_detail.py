"""Coarser details: what is long and thin stays, in every part."""

import numpy as np
import pytest
import trimesh

from dipcg.mesh import Mesh, join
from dipcg.mesh.detail import TOLERANCE, standard

# A block, and threads on it that are much thinner than what the coarsest level may move.
THREADS = 20


@pytest.fixture(scope="module")
def brush() -> Mesh:
    block = trimesh.creation.icosphere(3, 0.3)
    pieces = [("block", block.vertices, block.faces)]
    for number in range(THREADS):
        # Each has another length, so that they are no copies.
        length = 0.5 + 0.02 * number
        thread = trimesh.creation.cylinder(0.001, length, sections=8)
        place = [0.02 * (number - THREADS / 2), 0, 0.3 + length / 2]
        pieces.append(("thread", thread.vertices + place, thread.faces))
    dots = trimesh.creation.icosphere(2, 0.001)
    pieces.append(("dot", dots.vertices + [0, 0.5, 0], dots.faces))
    return join(pieces)


def pieces_of(mesh: Mesh, part: str) -> list[trimesh.Trimesh]:
    faces = mesh.faces[mesh.parts == mesh.part_names.index(part)]
    return trimesh.Trimesh(mesh.vertices, faces).split(only_watertight=False).tolist()


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_threads_stay_at_every_level_of_detail(brush, level):
    coarse = standard(brush, TOLERANCE * 3**level)
    lengths = sorted(np.ptp(one.bounds[:, 2]) for one in pieces_of(coarse, "thread"))
    expected = [0.5 + 0.02 * number for number in range(THREADS)]
    np.testing.assert_allclose(lengths, expected, rtol=0.2)
    assert len(pieces_of(coarse, "block")) == 1
    assert coarse.part_names == brush.part_names


def test_what_is_kept_for_threads_leaves_the_rest_as_coarse(brush):
    counts = [len(standard(brush, TOLERANCE * 3**level).faces) for level in (0, 2, 3)]
    assert counts[0] > 2 * counts[1]
    assert counts[1] >= counts[2]
