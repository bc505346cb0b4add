"""What a file of an asset holds: named pieces with finishes, which stand on the floor around the origin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from dipcg.materials import Finish
from dipcg.mesh import Mesh
from dipcg.mesh.copies import Places
from dipcg.mesh.pieces import Piece, pieces
from dipcg.mesh.surface import Maps


@dataclass(frozen=True)
class Scene:
    """The name of the asset, its pieces, and a finish for each part; with maps all parts share one material."""

    name: str
    pieces: list[Piece]
    finishes: tuple[Finish, ...]
    maps: Maps | None = None

    def finish(self, piece: Piece) -> Finish:
        """The finish of a piece."""
        return self.finishes[piece.part]


def compose(
    mesh: Mesh, name: str, finishes: tuple[Finish, ...], maps: Maps | None = None, copies: bool = False
) -> Scene:
    """The scene of a mesh; with `copies` each shape that has some is there once."""
    return Scene(name, list(pieces(on_floor(mesh), maps, copies)), finishes, maps)


def on_floor(mesh: Mesh) -> Mesh:
    """The mesh moved so that its lowest point has the height 0 and the origin is under its middle."""
    low, high = mesh.bounds
    under = np.array([*(low + high)[:2] / 2, low[2]], np.float32)
    return replace(mesh, vertices=mesh.vertices - under)


def y_up(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Vectors of our axes (Z up, the front towards -Y) with Y up and the front towards +Z."""
    return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)


def places_y_up(places: Places) -> Places:
    """The places of a shape whose vertices are turned by `y_up`."""
    turn = y_up(np.eye(3)).T
    rotation = turn @ places.rotation @ turn.T
    return Places(places.scale[:, [0, 2, 1]], rotation, y_up(places.translation))
