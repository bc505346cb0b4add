"""An asset with quads and copies, which tests of files share, and the JSON of a GLB."""

import json
import struct
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from dipcg.export.asset import Asset
from dipcg.mesh import Mesh, Solid, join, make_mesh, pairs, triangulate

CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float32)
SIDES = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
COPIES = 12


def cube() -> Mesh:
    """A cube of six quads."""
    faces, polygon = triangulate(np.full(6, 4), SIDES.ravel())
    return make_mesh(CUBE, faces, quads=pairs(polygon.astype(np.int32)))


def garden(spread: float = 1.0, size: float = 1.0) -> Asset:
    """A block with seeds in it and beyond, each turned, scaled along its axes, and moved."""
    rng, seed = np.random.default_rng(0), trimesh.creation.icosphere(subdivisions=3)
    shape = size * seed.vertices * [0.01, 0.02, 0.05]
    turns, scales = Rotation.random(COPIES, random_state=0).as_matrix(), rng.uniform(0.5, 1.5, COPIES)
    places = rng.uniform(0, spread, (COPIES, 3))
    seeds = [Solid("seed", (s * shape) @ r.T + t, seed.faces) for s, r, t in zip(scales, turns, places, strict=True)]
    return Asset(join([Solid("block", CUBE, cube().faces), *seeds]), "garden", {})


def glb_json(path: Path) -> dict:
    """The JSON chunk of a binary glTF file, by the specification alone."""
    data = path.read_bytes()
    magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    return json.loads(data[20 : 20 + size])
