"""Retrieval, the cheapest baseline: the shape of a data set whose render has the features nearest to a picture's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dipcg.camera import View
from dipcg.data.codec import decode_mesh
from dipcg.data.shapes import Shapes, load_shapes
from dipcg.encoders import Features, encoder_input
from dipcg.images import MARGIN, Source, prepare
from dipcg.pipeline import Candidate, Inverter
from dipcg.render import Renderer, sample_look

BATCH = 32


class Neighbours:
    """Renders of the training split from random training views, as features of an estimator's encoder.

    `count` shapes at most, `views` renders of each. Raises ValueError when the data set has no training shapes.
    """

    def __init__(
        self, inverter: Inverter, folder: str | Path, count: int = 1000, views: int = 4, seed: int = 0
    ) -> None:
        self.inverter = inverter
        _, shapes = load_shapes(folder, "train")
        self.count = min(count, len(shapes.meshes))
        numbers = np.repeat(np.arange(self.count), views)
        self._views: list[View] = []
        self._x, features = shapes.x[numbers], []
        renderer, rng = Renderer(inverter.image_size), np.random.default_rng(seed)
        for start in range(0, len(numbers), BATCH):
            images = [self._render(shapes, int(number), renderer, rng) for number in numbers[start : start + BATCH]]
            features.append(self._encode(images))
        renderer.close()
        self._features = torch.cat(features)

    def find(self, image: Source) -> Candidate:
        """Parameters and camera of the nearest render; raises images.ImageError."""
        picture, _ = prepare(image, self.inverter.image_size)
        nearest = int((self._features @ self._encode([picture])[0]).argmax())
        params = self.inverter.generator.space.decode(self._x[nearest].astype(float))
        return Candidate(params, self._views[nearest])

    def _render(self, shapes: Shapes, number: int, renderer: Renderer, rng: np.random.Generator) -> np.ndarray:
        mesh = decode_mesh(shapes.meshes[number])
        generator = self.inverter.generator
        params = generator.space.decode(shapes.x[number].astype(float))
        self._views.append(generator.seen_from(params).sample(rng))
        look = sample_look(rng, len(mesh.part_names))
        return renderer.render(mesh, self._views[-1], look, MARGIN)

    @torch.inference_mode()
    def _encode(self, images: Sequence[np.ndarray]) -> Float[Tensor, "b f"]:
        pixels = torch.cat([encoder_input(image) for image in images])
        return torch.nn.functional.normalize(_pooled(self.inverter.model.encoder(pixels)), dim=1)


def _pooled(features: Features) -> Float[Tensor, "b f"]:
    """The summary, or the mean of the tokens for an encoder without one."""
    return features.summary if features.summary.shape[1] else features.tokens.mean(1)
