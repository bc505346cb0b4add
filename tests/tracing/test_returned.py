"""What a program may return, and the mesh that it becomes."""

from types import SimpleNamespace

import numpy as np
import pytest

from dipcg.tracing.draws import ProgramError
from dipcg.tracing.returned import read, triangles

VERTICES = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]]
QUAD, MIXED = [[0, 1, 2, 3]], [[0, 1, 2, 3], [0, 1, 4]]


@pytest.mark.parametrize(
    "made",
    [
        (VERTICES, MIXED),
        {"vertices": VERTICES, "faces": MIXED},
        SimpleNamespace(vertices=VERTICES, faces=MIXED),
        [SimpleNamespace(vertices=VERTICES, faces=MIXED)],
    ],
    ids=["pair", "dictionary", "object", "list"],
)
def test_polygons_become_triangles_whatever_holds_them(made):
    mesh = read(made)
    corners = {tuple(sorted(map(tuple, mesh.vertices[face].tolist()))) for face in mesh.faces}
    a, b, c, d, top = map(tuple, np.array(VERTICES, float).tolist())
    assert corners == {tuple(sorted(face)) for face in ((a, b, c), (a, c, d), (a, b, top))}


def test_three_quads_are_not_read_as_four_triangles():
    assert triangles(np.array([QUAD[0]] * 3)).tolist() == [[0, 1, 2], [0, 2, 3]] * 3


@pytest.mark.parametrize("made", ["a tower", None, 3, (1, 2, 3)])
def test_what_is_no_mesh_is_named(made):
    with pytest.raises(ProgramError, match=f"returned a {type(made).__name__}"):
        read(made)
