"""Training input: stored meshes become pictures while the network trains, never twice the same."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from dipcg.camera import View, encode_view
from dipcg.config import AugmentConfig
from dipcg.data.codec import decode_mesh
from dipcg.data.shapes import Shapes
from dipcg.generators import Generator
from dipcg.images import MARGIN
from dipcg.render import Look, Renderer, sample_look
from dipcg.training.augment import augment

RECENT = 1024  # rendered pictures kept for another use


class Batch(NamedTuple):
    """Pictures over their background, what they show as `x` with the camera's four numbers, and what counts."""

    images: UInt8[Tensor, "b 3 s s"] | Float[Tensor, "b t c"]
    """or what stands for them: the tokens of sentences"""
    x: Float[Tensor, "b d"]
    active: Bool[Tensor, "b p"]


def encoder_input(images: Tensor) -> Tensor:
    """What an encoder is given: pictures in [0, 1], tokens as they are."""
    return images.float() / 255 if images.dtype == torch.uint8 else images


class Picture(NamedTuple):
    """A rendered picture before augmentation: the number of its shape, its camera, whether it shows normals."""

    number: int
    view: View
    drawing: bool
    image: UInt8[np.ndarray, "s s 4"]


class Pictures(IterableDataset):
    """An endless stream of batches; each rendered picture is used `repeats` times with other augmentations."""

    def __init__(
        self,
        generator: Generator,
        shapes: Shapes,
        size: int,
        batch: int,
        repeats: int = 1,
        seed: int = 0,
        config: AugmentConfig | None = None,
    ) -> None:
        self.generator, self.shapes, self.size, self.batch, self.seed = generator, shapes, size, batch, seed
        self.fresh = max(1, batch // repeats)
        self.config = config or AugmentConfig()

    def __iter__(self) -> Iterator[Batch]:
        worker = get_worker_info()
        rng = np.random.default_rng([self.seed, worker.id if worker else 0])
        renderer = Renderer(self.size)
        recent = [self._render(renderer, rng) for _ in range(self.batch)]
        while True:
            for _ in range(self.fresh):
                self._keep(recent, self._render(renderer, rng), rng)
            chosen = rng.choice(len(recent), self.batch, replace=False)
            yield self._collate([self._augment(recent[i], rng) for i in chosen])

    def _render(self, renderer: Renderer, rng: np.random.Generator) -> Picture:
        number = int(rng.integers(len(self.shapes.meshes)))
        mesh, params = decode_mesh(self.shapes.meshes[number]), self.generator.space.decode(self.shapes.x[number])
        views = self.generator.seen_from(params)
        view = views.sample(rng) if rng.random() < self.config.views else views.middle
        drawing = rng.random() < self.config.lines
        look = Look(normals=True) if drawing else sample_look(rng, len(mesh.part_names))
        return Picture(number, view, drawing, renderer.render(mesh, view, look, MARGIN))

    def _keep(self, recent: list[Picture], picture: Picture, rng: np.random.Generator) -> None:
        if len(recent) < RECENT:
            recent.append(picture)
        else:
            recent[int(rng.integers(RECENT))] = picture

    def _augment(self, picture: Picture, rng: np.random.Generator) -> tuple:
        number, view, drawing, image = picture
        x = self.shapes.x[number]
        if rng.random() < self.config.flip and self.generator.mirrors is not None:
            image, view, x = flip(self.generator, image, view, x)
        pixels = augment(np.ascontiguousarray(image), self.config, rng, drawing)
        return pixels.transpose(2, 0, 1), np.concatenate([x, encode_view(view)]), self.shapes.active[number]

    def _collate(self, rows: list[tuple]) -> Batch:
        images, x, active = (np.stack(column) for column in zip(*rows, strict=True))
        return Batch(torch.from_numpy(images), torch.from_numpy(x.astype(np.float32)), torch.from_numpy(active))


def flip(generator: Generator, image: np.ndarray, view: View, x: np.ndarray) -> tuple[np.ndarray, View, np.ndarray]:
    """The mirrored picture with the camera and the parameters that it shows."""
    mirrored = View(-view.azimuth_deg, view.elevation_deg, view.distance, view.fov_deg)
    return image[:, ::-1], mirrored, generator.mirror(x)


def loader(pictures: IterableDataset, workers: int) -> DataLoader:
    """Batches prepared by `workers` other processes, a few ahead of the network."""
    return DataLoader(
        pictures,
        batch_size=None,
        num_workers=workers,
        prefetch_factor=4 if workers else None,
        pin_memory=torch.cuda.is_available(),
    )
