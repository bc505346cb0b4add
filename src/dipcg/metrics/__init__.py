"""Metrics: one file for each measure of accuracy, with `unit`, `better`, `worst` and a function `measure`.

`compares = "points"`, the default: `measure(a, b)` takes two sets of surface points, each made by `surface_points` with
the file's own `points`. `compares = "params"`: `measure(space, truth, estimate)` takes two sets of parameters.
Optional: `symmetric`, whether exchanging the two changes nothing; `variants`, further columns of the same unit and
direction.
`worst` is the value that a failed build counts as, so that failures worsen a mean instead of vanishing from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar

import numpy as np
from jaxtyping import Float

from dipcg import registry
from dipcg.mesh import Mesh

# Two sets may have different numbers of points.
Points = Float[np.ndarray, "_ 3"]
Shape = TypeVar("Shape", Mesh, np.ndarray)


@dataclass(frozen=True)
class Metric:
    """A number that says how far an estimate is from the truth; `worst` is what a failed build counts as."""

    name: str
    measure: Callable[..., float]
    unit: str
    better: Literal["lower", "higher"]
    worst: float
    compares: Literal["points", "params"] = "points"
    points: int = 10_000
    symmetric: bool = False
    variants: Mapping[str, Callable[..., float]] = field(default_factory=dict)

    @property
    def columns(self) -> list[Metric]:
        """The metric and its variants, each as a metric of its own."""
        own = replace(self, variants={})
        return [own, *(replace(own, name=name, measure=measure) for name, measure in self.variants.items())]


def load_metric(name: str) -> Metric:
    """Load a metric by name, or by path to a Python file.

    Raises LookupError for an unknown one and ValueError for a file that does not declare what it must.
    """
    module = registry.load("metrics", name)
    missing = [key for key in _REQUIRED if not hasattr(module, key)]
    if missing:
        raise ValueError(f"The metric {name!r} must define {', '.join(missing)}; see docs/extending.md.")
    declared = {key: getattr(module, key) for key in _REQUIRED + _OPTIONAL if hasattr(module, key)}
    return Metric(name, **declared)


def surface_points(mesh: Mesh, count: int, rng: np.random.Generator) -> Points:
    """Area-weighted points of the mesh in the frame every metric is measured in: see `normalise`."""
    return sample_surface(normalise(mesh), count, rng)


def sample_surface(mesh: Mesh, count: int, rng: np.random.Generator) -> Points:
    """Independent points, uniform over the surface, in the mesh's own units and in random order.

    Source: Osada et al. 2002, "Shape distributions", section 3.1. Raises ValueError for a surface without area.
    """
    corners = mesh.vertices[mesh.faces].astype(float)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(first, second), axis=1)
    if not area.sum() > 0:
        raise ValueError("The surface has no area to put points on.")
    face = rng.choice(len(area), count, p=area / area.sum())
    root, along = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return corners[face, 0] + root * ((1 - along) * first[face] + along * second[face])


def normalise(shape: Shape) -> Shape:
    """The mesh or points (`n 3`) with the bounding box centred on the origin and its longest side 1.

    Vertices that no face uses do not count. Raises ValueError for something without extent.
    """
    points = shape.vertices[shape.faces].reshape(-1, 3) if isinstance(shape, Mesh) else shape
    low, high = points.min(0), points.max(0)
    side = (high - low).max()
    if not side > 0:
        raise ValueError("A shape without extent cannot be measured.")
    if isinstance(shape, Mesh):
        return replace(shape, vertices=(shape.vertices - (low + high) / 2) / side)
    return (shape - (low + high) / 2) / side


_REQUIRED = ("measure", "unit", "better", "worst")
_OPTIONAL = ("compares", "points", "symmetric", "variants")
