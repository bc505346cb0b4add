"""Builds that try out a generator: a mesh, or what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from dipcg.mesh import Mesh
from dipcg.space import Params
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError

# The longest time of a build in seconds, and the most triangles of a mesh, by which a parameter's range is limited.
BUILD_S = 60.0
TRIANGLES = 300_000
# Meshes that are larger by themselves may have so many times the triangles that they have at the start.
GROWTH = 4
WORDS = {
    "raised": "no mesh comes out",
    "unusable": "no mesh comes out",
    "timeout": f"a build takes over {BUILD_S:g} s",
    "memory": "a build takes too much memory",
    "crashed": "the program that builds stops",
}

Tried = Mesh | str


class Trials:
    """Builds with worker processes; `report` gets the number of builds so far. A context manager.

    A mesh of more triangles than `most` counts as one that cannot be used.
    """

    def __init__(
        self, path: Path | str, report: Callable[[int], None] = lambda count: None, most: float = TRIANGLES
    ) -> None:
        self.pool = BuildPool(str(path), workers=2, timeout_s=BUILD_S)
        self.report, self.count, self.most = report, 0, most

    def start(self, params: Params) -> Mesh:
        """The mesh that everything is compared with; raises BuildError."""
        mesh = self.pool.build(params)
        self.most = max(TRIANGLES, GROWTH * len(mesh.faces))
        return mesh

    def meshes(self, many: Iterable[Params]) -> list[Tried]:
        """A mesh for each set of parameters, or in words why there is none."""
        return [self._counted(mesh) for mesh in self.pool.map(many, "full")]

    def __enter__(self) -> Trials:
        return self

    def __exit__(self, *_: object) -> None:
        self.pool.close()

    def _counted(self, mesh: Mesh | BuildError) -> Tried:
        self.count += 1
        self.report(self.count)
        if isinstance(mesh, BuildError):
            if mesh.reason == "start":
                raise mesh
            return WORDS[mesh.reason]
        return mesh if len(mesh.faces) <= self.most else f"the mesh has over {self.most:,} triangles"
