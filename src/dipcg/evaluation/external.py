"""Meshes that other tools made of the same pictures, under our protocol: a folder with NAME.glb or NAME.obj per case.

Alignment. Image-to-3D tools do not agree on axes, size, or which way is the front, and some return the object as the
camera saw it. So each mesh is centred and scaled like every other, turned by the best of the 24 rotations that map axes
to axes, and moved by iterative closest points with scale (Besl & McKay 1992) if that brings it nearer. Our estimates
get none of this.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from dipcg.evaluation.evaluate import Case, columns
from dipcg.evaluation.tables import Table
from dipcg.evaluation.topology import Topology, quads_in, topology
from dipcg.images import load_image, save_image
from dipcg.mesh import Mesh, MeshError, make_mesh
from dipcg.metrics import Metric, Points, normalise, surface_points
from dipcg.metrics.chamfer import measure as chamfer

FORMATS = (".glb", ".gltf", ".obj", ".ply", ".stl")
# Points by which the rotation is chosen.
CHOSEN_BY = 1500
# Rounds of iterative closest points.
ROUNDS = 20


def write_pictures(cases: Iterable[Case], folder: Path) -> int:
    """Write each case's picture as NAME.png, for other tools to make NAME.glb of; returns how many."""
    folder.mkdir(parents=True, exist_ok=True)
    count = 0
    for case in cases:
        save_image(load_image(case.image), folder / f"{case.name}.png")
        count += 1
    return count


def read_mesh(path: Path) -> Mesh:
    """Any mesh file that trimesh reads, as one mesh, Z up: glTF is Y up by definition, others stay as they are.

    Raises MeshError for a file without a usable mesh.
    """
    import trimesh

    try:
        made: Any = trimesh.load(path, force="mesh")
        vertices, faces = np.asarray(made.vertices), np.asarray(made.faces)
    except Exception as error:
        # The file may come from anywhere, and its reader may raise anything.
        raise MeshError(f"{path} has no mesh that can be read ({error}).") from None
    if path.suffix.lower() in (".glb", ".gltf"):
        vertices = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], 1)
    return make_mesh(vertices, faces)


def measure_meshes(
    cases: Iterable[Case],
    folder: Path,
    metrics: list[str] | None = None,
    report: Callable[[Case], None] = lambda c: None,
) -> tuple[Table, dict[str, Topology], dict[str, float]]:
    """A table with one row, `folder`'s, and the topology and the share of quads of each mesh by case.

    A case without a mesh, or with one that cannot be read, has the worst values, like a failed build. Raises ValueError
    when no case has one.
    """
    table = Table([metric for metric in columns(metrics or ()) if metric.compares == "points"])
    shapes: dict[str, Topology] = {}
    quads: dict[str, float] = {}
    for number, case in enumerate(cases):
        path, mesh = find_mesh(folder, case.name), None
        if path is not None:
            mesh = _try_read(path)
        if path is not None and mesh is not None:
            shapes[case.name] = topology(mesh)
            share = quads_in(path)
            quads |= {} if share is None else {case.name: share}
        values = measured(table.metrics, case, mesh, np.random.default_rng([1, number]))
        table.add(folder.name, values, failed=mesh is None)
        report(case)
    if not shapes:
        raise ValueError(f"{folder} has no readable mesh named after a case, such as test-0.glb or test-0.obj.")
    return table, shapes, quads


def measured(metrics: list[Metric], case: Case, mesh: Mesh | None, rng: np.random.Generator) -> dict[str, float]:
    """Values of the metrics that compare points, the mesh aligned to the case first."""
    values: dict[str, float] = {}
    for count in sorted({metric.points for metric in metrics}):
        truth = case.sample(count, rng)
        ours = None if mesh is None else align(surface_points(mesh, count, rng), truth)
        for metric in metrics:
            if metric.points == count:
                values[metric.name] = metric.worst if ours is None else metric.measure(ours, truth)
    return values


def find_mesh(folder: Path, name: str) -> Path | None:
    """The mesh of a case, or None."""
    return next((path for suffix in FORMATS if (path := folder / f"{name}{suffix}").is_file()), None)


def align(points: Points, truth: Points) -> Points:
    """The points aligned to the truth as the text of this module says."""
    few, target = points[:CHOSEN_BY], truth[:CHOSEN_BY]
    rotation = min(axis_rotations(), key=lambda r: chamfer(normalise(few @ r.T), target))
    turned = normalise(points @ rotation.T)
    closer = closest_points(turned, truth)
    return min(turned, closer, key=lambda moved: chamfer(moved[:CHOSEN_BY], target))


def axis_rotations() -> list[Float[np.ndarray, "3 3"]]:
    """The 24 rotations that map axes to axes."""
    orders = permutations(range(3))
    matrices = [np.eye(3)[list(order)] * np.array(signs)[:, None] for order in orders for signs in _SIGNS]
    return [matrix for matrix in matrices if np.linalg.det(matrix) > 0]


def closest_points(points: Points, truth: Points) -> Points:
    """Iterative closest points with rotation, scale and shift (Besl & McKay 1992, solved as in Umeyama 1991)."""
    tree = KDTree(truth)
    for _ in range(ROUNDS):
        points = _similar(points, truth[tree.query(points)[1]])
    return points


def _similar(points: Points, target: Points) -> Points:
    """The points under the similarity that brings each nearest to its target, in squared distance."""
    centre, goal = points.mean(0), target.mean(0)
    a, b = points - centre, target - goal
    u, spread, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    scale = (spread * signs).sum() / max(float((a**2).sum()), 1e-12)
    return scale * a @ (u * signs @ vt).T + goal


def _try_read(path: Path) -> Mesh | None:
    try:
        return read_mesh(path)
    except MeshError:
        return None


_SIGNS = list(product((1.0, -1.0), repeat=3))
