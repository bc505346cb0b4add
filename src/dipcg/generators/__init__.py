"""Generators: one file each, which declares a `space` and a function `build(params)`.

Optional in the file:
`build_light(params)`, a fast, coarse mesh of the same surface;
`prepare()`, slow imports that a worker does once, before it is timed;
`views`, the range of cameras for training pictures;
`views_of(params)`, a smaller range for an asset that looks the same from two sides, so that one picture shows one `x`;
`mirrors`, for each parameter that a flipped picture changes, the one it becomes ("-name" where the sign of `x` turns),
or None where a flipped picture shows no asset of this generator;
`needs`, the packages to install;
`recycle_after`, the number of builds after which a worker process is replaced;
`light_faces`, the number of triangles that light meshes are simplified to, where the usual one would lose too much;
`blender`, the program of another Blender in whose Python the file runs;
`inputs`, for each parameter the input of a Geometry Nodes modifier that it sets, and the axis of a vector.

A generator is a pure function: the same parameters give the same mesh, without a clock or global random state. The
Infinigen adapters set values on Infinigen's own factories and node graphs and copy no code. A node graph is made once
in a worker, and a build sets values on its nodes. The chair calls the factory's methods part by part and reads each
part as arrays; draws inside them return the middle of their range. The basket's holes are cut by Manifold instead of
Blender. Light builds use fewer segments and points; `tests/contracts` compares them with the full surface. Triangles
are put in an order of our own, because Blender's order depends on memory addresses; some bevelled vertices of a chair
still differ between builds, by far less than a micrometre.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int64

from dipcg import registry
from dipcg.blender.declaration import read_declaration
from dipcg.camera import ViewGrid, ViewRange
from dipcg.labels import labelled
from dipcg.mesh import Mesh, make_mesh
from dipcg.mesh.detail import standard
from dipcg.mesh.simplify import simplify
from dipcg.openscad.declaration import read_scad
from dipcg.space import ParameterSpace, Params
from dipcg.tracing.declaration import read_program

Detail = Literal["light", "standard", "full"]
LIGHT_FACES = 3500


@dataclass(frozen=True)
class Generator:
    """A pure function from parameters to a mesh, with the declaration of its parameters."""

    name: str
    ref: str
    doc: str
    space: ParameterSpace
    build_full: Callable[[Params], Any]
    build_light: Callable[[Params], Any] | None = None
    prepare: Callable[[], None] = lambda: None
    views: ViewRange | ViewGrid = field(default_factory=ViewRange)
    views_of: Callable[[Params], ViewRange] | None = None
    mirrors: Mapping[str, str] | None = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    recycle_after: int = 10_000
    light_faces: int = LIGHT_FACES
    blender: str = ""
    inputs: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def missing(self) -> list[str]:
        """The packages it needs that are not installed here."""
        return [name for name in self.needs if find_spec(name) is None]

    def check_installed(self) -> None:
        """Raise ModuleNotFoundError with the command that helps when a needed package is missing."""
        if self.missing:
            raise ModuleNotFoundError(
                f"The generator {self.name!r} needs {' and '.join(self.missing)}: "
                "run `pip install 'dipcg[infinigen]'` (Python 3.11), then `dipcg doctor`."
            )

    def seen_from(self, params: Params) -> ViewRange | ViewGrid:
        """The cameras that pictures of an asset are taken from."""
        return self.views_of(params) if self.views_of else self.views

    @property
    def mirror_map(self) -> tuple[Int64[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """For each parameter of a mirrored asset, the index in `x` that it comes from and the sign that it gets."""
        names = self.space.names
        others = [(self.mirrors or {}).get(name, name) for name in names]
        index = np.array([names.index(other.lstrip("-")) for other in others])
        return index, np.array([-1.0 if other.startswith("-") else 1.0 for other in others])

    def mirror(self, x: Float[np.ndarray, "*n p"]) -> Float[np.ndarray, "*n p"]:
        """The parameters, as `x`, of the asset mirrored left to right."""
        index, sign = self.mirror_map
        return x[..., index] * sign

    def build(self, params: Params, detail: Detail = "full") -> Mesh:
        """Build the mesh in this process; use `workers.pool.BuildPool` for generators that run Blender.

        Raises ValueError for an unusable mesh, and whatever the generator raises.
        """
        light = self.build_light if detail == "light" else None
        return self.reduced(as_mesh((light or self.build_full)(params)), detail)

    def reduced(self, mesh: Mesh, detail: Detail) -> Mesh:
        """A full mesh, or for light detail what `build_light` gives, with the triangles of a level of detail."""
        if detail == "light":
            return simplify(mesh, self.light_faces)
        return mesh if detail == "full" else standard(mesh)


def load_generator(ref: str) -> Generator:
    """Load a generator by name, or by path to a Python file or to a TOML file of `dipcg generators add`.

    Raises LookupError for an unknown one and ValueError for a file that does not declare what it must.
    """
    is_path = registry.is_path(ref)
    # A path has one spelling, so that ./lamp.toml and lamp.toml are the same.
    ref = str(Path(ref)) if is_path else ref
    module = _read_toml(Path(ref)) if ref.endswith(".toml") else registry.load("generators", ref)
    if not isinstance(getattr(module, "space", None), ParameterSpace) or not callable(getattr(module, "build", None)):
        raise ValueError(
            f"The generator {ref!r} must define `space`, a ParameterSpace, and a function `build`; "
            "see docs/extending.md."
        )
    optional = {key: getattr(module, key) for key in _OPTIONAL if hasattr(module, key)}
    doc = (module.__doc__ or "").strip()
    space = labelled(module.space, getattr(module, "labels", {}))
    return Generator(Path(ref).stem if is_path else ref, ref, doc, space, module.build, **optional)


def as_mesh(built: Any) -> Mesh:
    """What a build may return, as a checked mesh: a `Mesh`, a trimesh, or (vertices, faces)."""
    if isinstance(built, Mesh):
        return make_mesh(**{field.name: getattr(built, field.name) for field in fields(Mesh)})
    if hasattr(built, "vertices") and hasattr(built, "faces"):
        return make_mesh(built.vertices, built.faces)
    vertices, faces = built
    return make_mesh(vertices, faces)


def _read_toml(path: Path) -> SimpleNamespace:
    """What a TOML file declares, by the key that names what it is over: a Blender file when there is no other."""
    try:
        keys = set(tomllib.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        keys = set()
    return next((read for key, read in _READERS.items() if key in keys), read_declaration)(path)


_READERS = {"program": read_program, "scad": read_scad}
_OPTIONAL = ("build_light", "prepare", "views", "views_of", "mirrors", "needs", "recycle_after", "light_faces")
_OPTIONAL += ("blender", "inputs")
