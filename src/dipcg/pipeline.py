"""From a picture to an editable asset: the file to read first.

image -> tokens -> x -> params -> mesh
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS, View, decode_view, encode_view
from dipcg.encoders import Features, encoder_input
from dipcg.export.asset import Asset
from dipcg.generators import Detail, Generator
from dipcg.images import Background, Source, prepare
from dipcg.mesh import Mesh
from dipcg.model.checkpoint import load_checkpoint
from dipcg.model.constraints import check_kept, encoded, needed
from dipcg.model.denoiser import Condition, Prediction
from dipcg.model.estimators import AnyEstimator
from dipcg.model.sampling import sample
from dipcg.model.uncertainty import central_first, spread, widened
from dipcg.model.zoo import find_checkpoint
from dipcg.space import Choice, Params, Value
from dipcg.workers.pool import BuildPool

Locks = tuple[Float[Tensor, " d"], Bool[Tensor, " d"]]  # values of x, and which of them are given
NO_PICTURE = np.zeros((128, 128, 4), np.uint8)  # of what was told in words
EXPECTED_OVER = 8  # draws of noise over which the expected candidate is averaged


@dataclass(frozen=True)
class Candidate:
    """One of the things the picture may show: parameters and the camera that saw them.

    `agreement`, from 0 to 1, says how well its render matches the picture, and `mesh` is the light mesh; both are None
    until `rank.rank` has built it, and stay so when it cannot be built.
    """

    params: Params
    view: View
    agreement: float | None = None
    mesh: Mesh | None = None


class Step(NamedTuple):
    """Where a search stood: seconds and builds since its start, and the misfit of the best so far."""

    seconds: float
    builds: int
    misfit: float


@dataclass(frozen=True)
class Estimate:
    """What a picture shows: the expected candidate first, then samples, the most central first, and how they differ.

    `spread` has for each parameter the standard deviation over the samples (reals, in natural units) or the share of
    samples that agree with the expected candidate (choices). `chances` has the probability of each option of each
    choice, where the choice is active. `expected` is the expected candidate whatever the order, `kept` what was held.
    `misfit`, from 0 to 1 and None before ranking, says how far even the best candidate is from the picture; `trace` is
    how `refine.refine` lowered it.
    """

    candidates: list[Candidate]
    spread: dict[str, float]
    chances: dict[str, dict[Value, float]]
    image: UInt8[np.ndarray, "s s 4"]
    background: Background | Literal["words"]
    inverter: Inverter
    expected: Candidate
    kept: Params = field(default_factory=dict)
    misfit: float | None = None
    trace: list[Step] = field(default_factory=list)

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

    def __init__(self, model: AnyEstimator, generator: Generator, workers: int = 1) -> None:
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
        steps: int | None = None,
        seed: int = 0,
        keep: Mapping[str, Any] | None = None,
    ) -> Estimate:
        """Estimate the parameters of the generator that make what a picture shows.

        `keep` holds some parameters at given values; a choice that they need is held at its likeliest fitting option.
        Raises images.ImageError for a picture that cannot be used and ValueError for numbers below one or values that
        cannot be held.
        """
        picture, background = self._prepare(image)
        return self._estimated(self.features(picture), picture, background, candidates, steps, seed, keep)

    @torch.inference_mode()
    def estimate_views(
        self,
        images: Sequence[Source],
        candidates: int = 16,
        steps: int | None = None,
        seed: int = 0,
        keep: Mapping[str, Any] | None = None,
    ) -> Estimate:
        """Estimate one object that several pictures show, each from its own side, as `estimate` does from one.

        Picture and camera of the result are the first one's. Raises what `estimate` does, and ValueError without any.
        """
        if not images:
            raise ValueError("Give at least one picture.")
        prepared = [self._prepare(image) for image in images]
        features = [self.features(picture) for picture, _ in prepared]
        together = Features(*(torch.cat(parts) for parts in zip(*features, strict=True)))
        return self._estimated(together, *prepared[0], candidates, steps, seed, keep)

    @torch.inference_mode()
    def describe(
        self,
        text: str,
        candidates: int = 16,
        steps: int | None = None,
        seed: int = 0,
        keep: Mapping[str, Any] | None = None,
    ) -> Estimate:
        """Estimate the parameters of the generator that make what a sentence says, as `estimate` does of a picture.

        The picture of the result is empty. Raises ValueError for a text that cannot be used, and when the checkpoint
        was trained on pictures.
        """
        from dipcg.encoders.sentence import check_text, embed

        if self.image_size:
            raise ValueError("This checkpoint reads pictures, not words; give it a picture.")
        features = self.model.encoder(embed([check_text(text)]))
        return self._estimated(features, NO_PICTURE, "words", candidates, steps, seed, keep)

    @torch.inference_mode()
    def guess(self, image: Source) -> Candidate:
        """The direct regression from the picture's summary, without the denoiser; raises images.ImageError."""
        prediction = self.model.first_guess(self.features(self._prepare(image)[0]))
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
            self._pool = BuildPool(self.generator, self._workers)
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

    def _estimated(
        self,
        features: Features,
        picture: UInt8[np.ndarray, "s s 4"],
        background: Background | Literal["words"],
        candidates: int,
        steps: int | None,
        seed: int,
        keep: Mapping[str, Any] | None,
    ) -> Estimate:
        steps = self.model.config.steps if steps is None else steps
        if min(candidates, steps) < 1:
            raise ValueError(f"candidates and steps must be at least 1, got {candidates} and {steps}.")
        kept, rng = check_kept(self.generator.space, keep or {}), np.random.default_rng(seed)
        size = len(self.generator.space) + VIEW_NUMBERS
        noise = torch.from_numpy(rng.standard_normal((EXPECTED_OVER + candidates - 1, size))).float()
        condition = self.model.condition(features)
        kept = self._with_needed(kept, condition, noise[:EXPECTED_OVER])
        locks = self._locks(kept)
        mean = self._expected(condition, noise[:EXPECTED_OVER], locks)
        expected = self._candidate(self._modes(mean, locks)[0], kept)
        drawn = [self._candidate(x, kept) for x in self._drawn(condition, noise[EXPECTED_OVER:], steps, locks, mean)]
        differ = spread(self.generator.space, expected.params, [c.params for c in drawn or [expected]])
        found = [expected, *(drawn[i] for i in central_first(self._points(drawn)))]
        return Estimate(found, differ, self._chances(mean, kept), picture, background, self, expected, kept)

    def _prepare(self, image: Source) -> tuple[UInt8[np.ndarray, "s s 4"], Background]:
        if not self.image_size:
            raise ValueError("This checkpoint reads words, not pictures; give it a text.")
        return prepare(image, self.image_size)

    def _expected(self, condition: Condition, noise: Tensor, locks: Locks) -> Prediction:
        """The mean of reals and the probabilities of choices: what the denoiser expects before its first step.

        Nearer to the truth than one sample is in the mean, since a sample also draws what the picture does not tell.
        """
        first = self._sample(condition, noise, self.model.config.expecting_steps, locks)
        chance = self.model.outputs.log_probabilities(first.logits).exp().mean(0, keepdim=True)
        return Prediction(first.mean.mean(0, keepdim=True), chance.log())

    def _drawn(
        self, condition: Condition, noise: Tensor, steps: int, locks: Locks, mean: Prediction
    ) -> Float[np.ndarray, "k d"]:
        if not len(noise):
            return np.empty((0, noise.shape[1]))
        found = self._modes(self._sample(condition, noise, steps, locks), locks)
        free = ~(self.model.outputs.is_choice | locks[1]).numpy()
        return widened(found, self._modes(mean, locks)[0], self.model.config.widen, free)

    def _modes(self, prediction: Prediction, locks: Locks) -> Float[np.ndarray, "k d"]:
        return torch.where(locks[1], locks[0], self.model.outputs.modes(prediction)).double().numpy()

    def _sample(self, condition: Condition, noise: Tensor, steps: int, locks: Locks) -> Prediction:
        views, count = len(condition.summary), len(noise)
        known, given = (part.repeat(views * count, 1) for part in locks)
        repeated = condition.repeat(count)
        found = sample(self.model, repeated, noise.repeat(views, 1), steps, known=known, given=given, views=views)
        return Prediction(found.mean[:count], found.logits[:count])

    def features(self, picture: UInt8[np.ndarray, "s s 4"]) -> Features:
        """What the encoder makes of a prepared picture."""
        return self.model.encoder(encoder_input(picture))

    def _with_needed(self, kept: Params, condition: Condition, noise: Tensor) -> Params:
        """What is held, and each choice without which some of it would do nothing at its likeliest fitting option."""
        options = needed(self.generator.space, kept)
        if not options:
            return kept
        chances = self._chances(self._expected(condition, noise, self._locks(kept)), kept)
        return kept | {name: max(fitting, key=chances[name].__getitem__) for name, fitting in options.items()}

    def _chances(self, expected: Prediction, kept: Params) -> dict[str, dict[Value, float]]:
        shares = iter(expected.logits.exp()[0].tolist())
        chances = {p.name: {o: next(shares) for o in p.options} for p in self.generator.space if isinstance(p, Choice)}
        held = {name: kept[name] for name in chances.keys() & kept.keys()}
        return chances | {name: {o: float(o == value) for o in chances[name]} for name, value in held.items()}

    def _locks(self, kept: Params) -> Locks:
        known, given = encoded(self.generator.space, kept, VIEW_NUMBERS)
        return torch.from_numpy(known).float(), torch.from_numpy(given)

    def _candidate(self, x: Float[np.ndarray, " d"], kept: Params) -> Candidate:
        space = self.generator.space
        params = space.replace(space.decode(x[:-VIEW_NUMBERS]), kept)
        return Candidate(params, decode_view(x[-VIEW_NUMBERS:]))

    def _points(self, found: list[Candidate]) -> Float[np.ndarray, "n d"]:
        space = self.generator.space
        points = [np.r_[space.encode(c.params), encode_view(c.view)] for c in found]
        return np.array(points).reshape(len(found), len(space) + VIEW_NUMBERS)
