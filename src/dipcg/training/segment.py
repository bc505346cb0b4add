"""Fits the segmenter that cuts objects out of photographs, on renders over random grounds."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, UInt8
from safetensors.torch import save
from torch import Tensor

from dipcg.data.codec import decode_mesh
from dipcg.data.shapes import load_shapes
from dipcg.files import write_file
from dipcg.images.segmenter import SIDE, Segmenter
from dipcg.render import Renderer, sample_look
from dipcg.training.grounds import Photograph, Scene, sample_scene

BATCH, RATE, WARM_UP = 32, 2e-3, 50
# Drawing a scene takes as long as learning from it, so each is used several times, with other colours.
POOL, USES = 1024, 4
VIEW_SIDE = 128

Report = Callable[[int, float], None]


def render_views(folder: str | Path, split: str, count: int, seed: int = 0) -> list[UInt8[np.ndarray, "s s 4"]]:
    """Random views of a data set's shapes with straight alpha."""
    generator, shapes = load_shapes(folder, split)
    renderer, rng = Renderer(VIEW_SIDE), np.random.default_rng(seed)
    views = []
    for number in range(count):
        mesh = decode_mesh(shapes.meshes[number % len(shapes.meshes)])
        look = sample_look(rng, len(mesh.part_names))
        views.append(renderer.render(mesh, generator.views.sample(rng), look, margin=0.02))
    renderer.close()
    return views


def fit_segmenter(
    views: Sequence[UInt8[np.ndarray, "s s 4"]],
    photographs: Sequence[Photograph],
    steps: int,
    seed: int = 0,
    report: Report = lambda step, loss: None,
) -> Segmenter:
    """Train for so many steps on scenes of the views; `report` is called with the number of steps, and the loss."""
    torch.manual_seed(seed)
    network = Segmenter().train()
    # Pictures come channels last, in which convolutions are a quarter faster.
    network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
    optimiser = torch.optim.AdamW(network.parameters(), RATE, weight_decay=0.01)
    pool = ScenePool(views, photographs, np.random.default_rng(seed))
    for step in range(steps):
        optimiser.param_groups[0]["lr"] = RATE * min(1, (step + 1) / WARM_UP, 1.6 * (1 - step / steps))
        pictures, coverage = pool.batch()
        loss = _loss(network(pictures), coverage)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        report(step + 1, loss.item())
    return network.eval()


class ScenePool:
    """The latest scenes of an endless series, of which batches are drawn; new ones take the places of the oldest."""

    def __init__(
        self, views: Sequence[UInt8[np.ndarray, "s s 4"]], photographs: Sequence[Photograph], rng: np.random.Generator
    ) -> None:
        self._views, self._photographs, self._rng = views, photographs, rng
        self._pool: list[Scene] = []
        self._drawn = 0

    def batch(self) -> tuple[Float[Tensor, "b 3 s s"], Float[Tensor, "b 1 s s"]]:
        """Pictures in [0, 1], and where the object is; half are mirrored, and colours change places."""
        for _ in range(BATCH // USES if len(self._pool) >= BATCH else BATCH):
            self._add(sample_scene(self._views, SIDE, self._rng, self._photographs))
        chosen = [self._changed(self._pool[i]) for i in self._rng.integers(len(self._pool), size=BATCH)]
        pictures = torch.from_numpy(np.stack([scene.picture for scene in chosen])).permute(0, 3, 1, 2)
        return pictures.float() / 255, torch.from_numpy(np.stack([scene.coverage for scene in chosen]))[:, None]

    def _add(self, scene: Scene) -> None:
        if len(self._pool) < POOL:
            self._pool.append(scene)
        else:
            self._pool[self._drawn % POOL] = scene
        self._drawn += 1

    def _changed(self, scene: Scene) -> Scene:
        across, colours = self._rng.choice([-1, 1]), self._rng.permutation(3)
        return Scene(scene.picture[:, ::across, colours], np.ascontiguousarray(scene.coverage[:, ::across]))


def save_segmenter(network: Segmenter, path: Path, about: dict[str, str | int | float]) -> None:
    """Write the weights in half precision, and a card beside them that says how they were made."""
    weights = {name: value for name, value in network.state_dict().items() if value.is_floating_point()}
    write_file(path, save({name: value.half().contiguous() for name, value in weights.items()}))
    write_file(path.with_suffix(".json"), json.dumps(about, indent=2) + "\n")


def _loss(logits: Float[Tensor, "b 1 s s"], coverage: Float[Tensor, "b 1 s s"]) -> Float[Tensor, ""]:
    """Cross entropy, and what the soft intersection over union lacks of 1 (Rahman and Wang 2016)."""
    found = logits.sigmoid()
    both = (found * coverage).sum((1, 2, 3))
    overlap = (both + 1) / ((found + coverage).sum((1, 2, 3)) - both + 1)
    return F.binary_cross_entropy_with_logits(logits, coverage) + 1 - overlap.mean()
