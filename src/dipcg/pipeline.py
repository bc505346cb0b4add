"""From a picture to an editable asset: the file to read first.

image -> tokens -> x -> params -> mesh
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS, View, decode_view, encode_view
from dipcg.checkpoint import load_checkpoint
from dipcg.denoiser import Condition, Estimator, Prediction
from dipcg.encoders import Features
from dipcg.export import Asset
from dipcg.generators import Detail, Generator
from dipcg.images import Background, Source, over_white, prepare
from dipcg.sampling import sample
from dipcg.space import Params, Real
from dipcg.weights import find_checkpoint
from dipcg.worker import BuildPool

Locks = tuple[Float[Tensor, " d"], Bool[Tensor, " d"]]  # values of x, and which of them are given
EXPECTED_OVER = 8  # draws of noise over which the expected candidate is averaged


@dataclass(frozen=True)
class Candidate:
    """One of the things the picture may show: parameters and the camera that saw them."""

    params: Params
    view: View


@dataclass(frozen=True)
class Estimate:
    """What a picture shows: the expected candidate first, then samples, the most central first, and how they differ.

    `spread` has for each parameter the standard deviation over the samples (reals, in natural units) or the share of
    samples that agree with the first candidate (choices).
    """

    candidates: list[Candidate]
    spread: dict[str, float]
    image: UInt8[np.ndarray, "s s 4"]
    background: Background
    inverter: Inverter

    @property
    def params(self) -> Params:
        """The parameters of the best candidate."""
        return self.candidates[0].params

    @property
    def view(self) -> View:
        """The camera of the best candidate."""
        return self.candidates[0].view

    def build(self, candidate: int = 0, detail: Detail = "full") -> Asset:
        """Build a candidate; raises worker.BuildError with a sentence."""
        return self.inverter.build(self.candidates[candidate].params, detail)


class Inverter:
    """A trained estimator with the workers that build what it finds; a context manager.

    >>> estimate = Inverter.load("chair").estimate("photo.png")
    >>> estimate.build().export("chair.glb")
    """

    def __init__(self, model: Estimator, generator: Generator, workers: int = 1) -> None:
        self.model, self.generator = model.eval(), generator
        self._workers = workers
        self._pool: BuildPool | None = None

    @classmethod
    def load(cls, name: str, workers: int = 1) -> Inverter:
        """Load the checkpoint that ships for a generator, or one from a folder.

        Raises LookupError for an unknown name and weights.CheckpointError with a sentence.
        """
        model, generator, _ = load_checkpoint(find_checkpoint(name))
        return cls(model, generator, workers)

    @torch.inference_mode()
    def estimate(
        self,
        image: Source,
        candidates: int = 16,
        steps: int = 10,
        seed: int = 0,
        keep: Mapping[str, Any] | None = None,
    ) -> Estimate:
        """Estimate the parameters of the generator that make what a picture shows.

        `keep` holds some parameters at given values. Raises images.ImageError for a picture that cannot be used and
        ValueError for numbers below one or values out of range.
        """
        if min(candidates, steps) < 1:
            raise ValueError(f"candidates and steps must be at least 1, got {candidates} and {steps}.")
        picture, background = prepare(image, self.image_size)
        locks, rng = self._locks(keep or {}), np.random.default_rng(seed)
        noise = torch.from_numpy(rng.standard_normal((EXPECTED_OVER + candidates - 1, len(locks[0])))).float()
        condition = self.model.condition(self._features(picture))
        expected = self._candidate(self._expected(condition, noise[:EXPECTED_OVER], locks), keep or {})
        drawn = [self._candidate(x, keep or {}) for x in self._drawn(condition, noise[EXPECTED_OVER:], steps, locks)]
        spread = self._spread(expected, drawn or [expected])
        return Estimate([expected, *self._central_first(drawn)], spread, picture, background, self)

    @torch.inference_mode()
    def guess(self, image: Source) -> Candidate:
        """The direct regression from the picture's summary, without the denoiser; raises images.ImageError."""
        prediction = self.model.first_guess(self._features(prepare(image, self.image_size)[0]))
        return self._candidate(self.model.outputs.modes(prediction)[0].double().numpy(), {})

    def build(self, params: Params, detail: Detail = "full") -> Asset:
        """Build parameters in a worker process; raises worker.BuildError with a sentence."""
        return Asset(self.pool.build(params, detail), self.generator.ref, params)

    @property
    def image_size(self) -> int:
        """Side of the square pictures that the encoder is given."""
        return int(self.model.encoder.image_size)  # type: ignore[arg-type]

    @property
    def pool(self) -> BuildPool:
        """The worker processes, started at first use."""
        if self._pool is None:
            self._pool = BuildPool(self.generator.ref, self._workers)
        return self._pool

    def close(self) -> None:
        """Stop the worker processes."""
        if self._pool is not None:
            self._pool.close()
            self._pool = None

    def __enter__(self) -> Inverter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _expected(self, condition: Condition, noise: Tensor, locks: Locks) -> Float[np.ndarray, " d"]:
        """The mean of reals and the likeliest of choices: what the denoiser expects before its first step.

        Nearer to the truth than one sample is in the mean, since a sample also draws what the picture does not tell.
        """
        first = self._sample(condition, noise, 1, locks)
        chance = self.model.outputs.log_probabilities(first.logits).exp().mean(0, keepdim=True)
        mean = Prediction(first.mean.mean(0, keepdim=True), chance.log())
        return torch.where(locks[1], locks[0], self.model.outputs.modes(mean))[0].double().numpy()

    def _drawn(
        self, condition: Condition, noise: Tensor, steps: int, locks: Locks
    ) -> Float[np.ndarray, "k d"] | list[np.ndarray]:
        if not len(noise):
            return []
        drawn = self.model.outputs.modes(self._sample(condition, noise, steps, locks))
        return torch.where(locks[1], locks[0], drawn).double().numpy()

    def _sample(self, condition: Condition, noise: Tensor, steps: int, locks: Locks) -> Prediction:
        known, given = (part.repeat(len(noise), 1) for part in locks)
        return sample(self.model, condition.repeat(len(noise)), noise, steps, known=known, given=given)

    def _features(self, picture: np.ndarray) -> Features:
        return self.model.encoder(torch.from_numpy(over_white(picture)).permute(2, 0, 1)[None].float() / 255)

    def _locks(self, keep: Mapping[str, Any]) -> Locks:
        space, size = self.generator.space, len(self.generator.space) + VIEW_NUMBERS
        known, given = torch.zeros(size), torch.zeros(size, dtype=torch.bool)
        for name, value in keep.items():
            index, parameter = space.find(name)
            known[index], given[index] = parameter.encode(parameter.check(value)), True
        return known, given

    def _candidate(self, x: Float[np.ndarray, " d"], keep: Mapping[str, Any]) -> Candidate:
        space = self.generator.space
        params = space.replace(space.decode(x[:-VIEW_NUMBERS]), keep)
        return Candidate(params, decode_view(x[-VIEW_NUMBERS:]))

    def _central_first(self, found: list[Candidate]) -> list[Candidate]:
        """Order by the mean distance to all others in x: one sample may be odd, the most central one seldom is."""
        if len(found) < 2:
            return found
        points = np.array([np.r_[self.generator.space.encode(c.params), encode_view(c.view)] for c in found])
        distance = np.abs(points[:, None] - points[None]).mean((1, 2))
        return [found[i] for i in np.argsort(distance, kind="stable")]

    def _spread(self, first: Candidate, drawn: list[Candidate]) -> dict[str, float]:
        spread = {}
        for p in self.generator.space:
            values = [c.params[p.name] for c in drawn]
            if isinstance(p, Real):
                spread[p.name] = float(np.std([float(value) for value in values]))
            else:
                spread[p.name] = values.count(first.params[p.name]) / len(values)
        return spread
