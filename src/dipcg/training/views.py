"""Rendered views of the shapes of a data set, kept in memory for several uses.

Rendering a view takes about as long as learning from it, so each is used several times, with other changes each time.
The buffer holds the latest views; new ones take the places of the oldest, so that a network never sees a fixed set.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS, View, ViewRange, encode_view
from dipcg.config import AugmentConfig
from dipcg.data.codec import decode_mesh
from dipcg.data.shapes import Shapes
from dipcg.generators import Generator
from dipcg.images import MARGIN
from dipcg.render import Look, Renderer, sample_look
from dipcg.space import Params

# The elevations of "extreme" views, in degrees.
EXTREME_ELEVATIONS = (-25.0, 80.0)


class Drawn(NamedTuple):
    """Some views of the buffer, and what they show as `x` with the camera's numbers."""

    views: UInt8[Tensor, "b 4 s s"]
    """straight alpha"""
    x: Float[Tensor, "b d"]
    active: Bool[Tensor, "b p"]
    normals: Bool[Tensor, " b"]
    """whether a view has the surface's normals as colours"""


class ViewBuffer:
    """The latest `slots` of an endless series of random views.

    View number `i` depends on the seed, the shapes and `i` alone, so a buffer that is filled anew up to the same number
    holds the same views. Every shape is shown once before any is shown again.
    """

    def __init__(
        self, generator: Generator, shapes: Shapes, config: AugmentConfig, slots: int, seed: int, device: torch.device
    ) -> None:
        self.generator, self.shapes, self.config, self.seed = generator, shapes, config, seed
        self.slots, self.device = slots, device
        self.rendered = 0
        self._size = 0
        self._order = (-1, np.empty(0, np.int64))

    def advance(self, rendered: int, size: int) -> None:
        """Render until view number `rendered` (exclusive), at least one buffer full, as pictures of `size` pixels."""
        rendered = max(rendered, self.slots)
        if size != self._size:
            self._start(size)
            self.rendered = rendered - self.slots
        for number in range(max(self.rendered, rendered - self.slots), rendered):
            self._render(number)
        self.rendered = rendered

    def draw(self, count: int, rng: torch.Generator) -> Drawn:
        """Random views of the buffer; the same one may be drawn twice."""
        chosen = torch.randint(self.slots, (count,), generator=rng, device=self.device)
        numbers = self._numbers[chosen]
        return Drawn(
            self._views[chosen].permute(0, 3, 1, 2),
            torch.cat([self._x[numbers], self._cameras[chosen]], 1),
            self._active[numbers],
            self._normals[chosen],
        )

    def close(self) -> None:
        """Free the renderer."""
        if self._size:
            self._renderer.close()

    def _start(self, size: int) -> None:
        self.close()
        self._size, self._renderer = size, Renderer(size)
        self._views = torch.zeros(self.slots, size, size, 4, dtype=torch.uint8, device=self.device)
        self._cameras = torch.zeros(self.slots, VIEW_NUMBERS, device=self.device)
        self._numbers = torch.zeros(self.slots, dtype=torch.long, device=self.device)
        self._normals = torch.zeros(self.slots, dtype=torch.bool, device=self.device)
        self._x = torch.from_numpy(self.shapes.x).to(self.device)
        self._active = torch.from_numpy(self.shapes.active).to(self.device)

    def _render(self, number: int) -> None:
        rng = np.random.default_rng([self.seed, number])
        shape = self._shape(number)
        mesh, params = decode_mesh(self.shapes.meshes[shape]), self.generator.space.decode(self.shapes.x[shape])
        view, normals = self._view(params, rng), rng.random() < self.config.lines
        look = Look(normals=True) if normals else sample_look(rng, len(mesh.part_names))
        slot = number % self.slots
        image = np.ascontiguousarray(self._renderer.render(mesh, view, look, MARGIN))
        self._views[slot] = torch.from_numpy(image)
        self._cameras[slot] = torch.from_numpy(encode_view(view))
        self._numbers[slot], self._normals[slot] = shape, normals

    def _shape(self, number: int) -> int:
        """The shape that a view shows: a new random order of all shapes for each pass over them."""
        passes, place = divmod(number, len(self.shapes.meshes))
        if self._order[0] != passes:
            self._order = (passes, np.random.default_rng([self.seed, passes, 1]).permutation(len(self.shapes.meshes)))
        return int(self._order[1][place])

    def _view(self, params: Params, rng: np.random.Generator) -> View:
        views = self.generator.seen_from(params)
        if rng.random() >= self.config.views:
            return views.middle
        if rng.random() < self.config.extreme and isinstance(views, ViewRange):
            views = replace(views, elevation_deg=_wider(views.elevation_deg))
        return views.sample(rng)


def _wider(elevation_deg: tuple[float | int, float | int]) -> tuple[float, float]:
    return min(elevation_deg[0], EXTREME_ELEVATIONS[0]), max(elevation_deg[1], EXTREME_ELEVATIONS[1])
