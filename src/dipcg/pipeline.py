"""From a picture to an editable asset: the file to read first.

image -> tokens -> x -> params -> mesh
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS, View, decode_view, encode_view
from dipcg.encoders import Features, encoder_input
from dipcg.export.asset import Asset
from dipcg.generators import Detail, Generator
from dipcg.images import Background, Cutout, Source, prepare
from dipcg.mesh import Mesh
from dipcg.model.checkpoint import load_checkpoint
from dipcg.model.constraints import Fixed, check_fixed, encode_fixed, needed_options
from dipcg.model.denoiser import Condition, Prediction
from dipcg.model.estimators import AnyEstimator
from dipcg.model.uncertainty import calibrated, central_first, spread
from dipcg.model.zoo import find_checkpoint
from dipcg.space import Choice, Params, Value
from dipcg.workers.pool import BuildPool

# The picture of an estimate from text.
NO_PICTURE = np.zeros((128, 128, 4), np.uint8)
# Draws of noise over which the expected candidate is averaged.
EXPECTED_OVER = 8


@dataclass(frozen=True)
class Candidate:
    """One object that the picture may show: parameters and the camera that saw them.

    `agreement`, from 0 to 1, says how well its render matches the picture. It and the light `mesh` are None until
    `rank` has built the candidate, and when it cannot be built.
    """

    params: Params
    view: View
    agreement: float | None = None
    mesh: Mesh | None = None


class Step(NamedTuple):
    """How far a search is: seconds and builds since its start, and the misfit of the best candidate so far."""

    seconds: float
    builds: int
    misfit: float


@dataclass(frozen=True)
class Estimate:
    """What a picture shows, as plain data: the expected candidate, then samples, the most central first.

    `generator` is a name, `ref` that name or a file, as `load_generator` reads it. `spread` has for each parameter the
    standard deviation over the samples (reals, in natural units) or the share of samples that agree with the expected
    candidate (choices). `probabilities` has those of the options of each choice, where the choice is active. `expected`
    is the expected candidate whatever the order, `fixed` the values that were fixed. `misfit`, from 0 to 1 and None
    before ranking, is 1 minus the best agreement; `trace` says how `refine` lowered it.
    """

    generator: str
    ref: str
    candidates: list[Candidate]
    spread: dict[str, float]
    probabilities: dict[str, dict[Value, float]]
    image: UInt8[np.ndarray, "s s 4"]
    background: Background | Literal["words"]
    expected: Candidate
    fixed: Params = field(default_factory=dict)
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


class Inverter:
    """A trained estimator of one generator, with the workers that build its meshes; a context manager.

    >>> with Inverter.load("chair") as inverter:
    ...     estimate = inverter.estimate("photo.png")
    ...     inverter.build(estimate.params).export("chair.glb")
    """

    def __init__(self, model: AnyEstimator, generator: Generator, workers: int = 1) -> None:
        self.model, self.generator = model.eval(), generator
        self._workers = workers
        self._pool: BuildPool | None = None

    @classmethod
    def load(cls, name: str, workers: int = 1) -> Inverter:
        """Load the checkpoint that ships for a generator, or one from a folder.

        Raises LookupError for an unknown name and zoo.CheckpointError with a sentence.
        """
        model, generator, _ = load_checkpoint(find_checkpoint(name))
        return cls(model, generator, workers)

    def estimate(
        self,
        image: Source | Cutout,
        candidates: int = 16,
        steps: int | None = None,
        seed: int = 0,
        fixed: Mapping[str, Any] | None = None,
    ) -> Estimate:
        """Estimate the parameters with which the generator makes what a picture shows.

        `fixed` has values for some parameters; a choice that they need is fixed at its likeliest fitting option.
        Raises images.ImageError for a picture that cannot be used and ValueError for numbers below one or values that
        cannot be fixed.
        """
        return self.estimate_views([image], candidates, steps, seed, fixed)

    @torch.inference_mode()
    def estimate_views(
        self,
        images: Sequence[Source | Cutout],
        candidates: int = 16,
        steps: int | None = None,
        seed: int = 0,
        fixed: Mapping[str, Any] | None = None,
    ) -> Estimate:
        """Estimate one object that several pictures show, each from its own side, as `estimate` does from one.

        Picture and camera of the result are the first one's. Raises what `estimate` does, and ValueError without any.
        """
        if not images:
            raise ValueError("Give at least one picture.")
        prepared = [self._prepare(image) for image in images]
        features = [self.features(picture) for picture, _ in prepared]
        together = Features(*(torch.cat(parts) for parts in zip(*features, strict=True)))
        return self._estimate(together, *prepared[0], candidates, steps, seed, fixed)

    @torch.inference_mode()
    def describe(
        self,
        text: str,
        candidates: int = 16,
        steps: int | None = None,
        seed: int = 0,
        fixed: Mapping[str, Any] | None = None,
    ) -> Estimate:
        """Estimate the parameters with which the generator makes what a sentence describes, as `estimate` does.

        The result has an empty picture. Raises ValueError for an unusable text, and if the checkpoint reads pictures.
        """
        from dipcg.encoders.sentence import check_text, embed

        if self.image_size:
            raise ValueError("This checkpoint reads pictures, not words; give it a picture.")
        features = self.model.encoder(embed([check_text(text)]))
        return self._estimate(features, NO_PICTURE, "words", candidates, steps, seed, fixed)

    @torch.inference_mode()
    def guess(self, image: Source | Cutout) -> Candidate:
        """The direct regression from the picture's summary, without the denoiser; raises images.ImageError."""
        guess = self.model.outputs.modes(self.model.first_guess(self.features(self._prepare(image)[0])))
        return self._candidate(guess[0].double().numpy(), {})

    def features(self, picture: UInt8[np.ndarray, "s s 4"]) -> Features:
        """The encoder's features of a prepared picture."""
        return self.model.encoder(encoder_input(picture))

    def build(self, params: Params, detail: Detail = "full") -> Asset:
        """Build parameters in a worker process; raises BuildError with a sentence."""
        return Asset(self.pool.build(params, detail), self.generator.ref, params)

    @property
    def image_size(self) -> int:
        """Side of the square pictures that the encoder takes; 0 for one that reads text."""
        return int(self.model.encoder.image_size)  # type: ignore[arg-type]

    @property
    def pool(self) -> BuildPool:
        """The worker processes, started at their first use."""
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

    def _prepare(self, image: Source | Cutout) -> tuple[UInt8[np.ndarray, "s s 4"], Background]:
        if not self.image_size:
            raise ValueError("This checkpoint reads words, not pictures; give it a text.")
        return prepare(image, self.image_size)

    def _estimate(
        self,
        features: Features,
        picture: UInt8[np.ndarray, "s s 4"],
        background: Background | Literal["words"],
        candidates: int,
        steps: int | None,
        seed: int,
        fixed: Mapping[str, Any] | None,
    ) -> Estimate:
        steps = self.model.config.steps if steps is None else steps
        if min(candidates, steps) < 1:
            raise ValueError(f"candidates and steps must be at least 1, got {candidates} and {steps}.")
        space, condition = self.generator.space, self.model.condition(features)
        size = (EXPECTED_OVER + candidates - 1, len(space) + VIEW_NUMBERS)
        drawn = torch.from_numpy(np.random.default_rng(seed).standard_normal(size)).float()
        noise, more = drawn[:EXPECTED_OVER], drawn[EXPECTED_OVER:]
        values = self._fix_needed(check_fixed(space, fixed or {}), condition, noise)
        entries = encode_fixed(space, values, VIEW_NUMBERS)
        mean = self._expect(condition, noise, entries)
        expected = self._candidate(self._modes(mean, entries)[0], values)
        samples = [self._candidate(x, values) for x in self._draw(condition, more, steps, entries, mean)]
        return Estimate(
            generator=self.generator.name,
            ref=self.generator.ref,
            candidates=[expected, *(samples[i] for i in central_first(self._points(samples)))],
            spread=spread(space, expected.params, [c.params for c in samples or [expected]]),
            probabilities=self._probabilities(mean, values),
            image=picture,
            background=background,
            expected=expected,
            fixed=values,
        )

    def _expect(self, condition: Condition, noise: Tensor, fixed: Fixed) -> Prediction:
        """The mean of reals and the probabilities of choices: what the denoiser expects before its first step.

        It is nearer to the truth on average than a sample, which also draws what the picture leaves open.
        """
        first, outputs = self._sample(condition, noise, self.model.config.expecting_steps, fixed), self.model.outputs
        probability = outputs.log_probabilities(first.logits).exp().mean(0, keepdim=True)
        return Prediction(first.mean.mean(0, keepdim=True), probability.log())

    def _draw(
        self, condition: Condition, noise: Tensor, steps: int, fixed: Fixed, mean: Prediction
    ) -> Float[np.ndarray, "k d"]:
        if not len(noise):
            return np.empty((0, noise.shape[1]))
        samples = self._modes(self._sample(condition, noise, steps, fixed), fixed)
        free = ~(self.model.outputs.is_choice | fixed.mask).numpy()
        return calibrated(samples, self._modes(mean, fixed)[0], self.model.config.calibration_scale, free)

    def _sample(self, condition: Condition, noise: Tensor, steps: int, fixed: Fixed) -> Prediction:
        views, count = len(condition.summary), len(noise)
        values, mask = (part.repeat(views * count, 1) for part in fixed)
        noise, every = noise.repeat(views, 1), condition.repeat(count)
        drawn = self.model.sample(every, noise, steps, values, mask, views)
        return Prediction(drawn.mean[:count], drawn.logits[:count])

    def _modes(self, prediction: Prediction, fixed: Fixed) -> Float[np.ndarray, "k d"]:
        return torch.where(fixed.mask, fixed.values, self.model.outputs.modes(prediction)).double().numpy()

    def _fix_needed(self, fixed: Params, condition: Condition, noise: Tensor) -> Params:
        """The fixed values, and each choice without which one of them does nothing, at its likeliest fitting option."""
        options = needed_options(self.generator.space, fixed)
        if not options:
            return fixed
        expected = self._expect(condition, noise, encode_fixed(self.generator.space, fixed, VIEW_NUMBERS))
        probabilities = self._probabilities(expected, fixed)
        return fixed | {name: max(fitting, key=probabilities[name].__getitem__) for name, fitting in options.items()}

    def _probabilities(self, expected: Prediction, fixed: Params) -> dict[str, dict[Value, float]]:
        shares = iter(expected.logits.exp()[0].tolist())
        choices = [p for p in self.generator.space if isinstance(p, Choice)]
        free = {p.name: {option: next(shares) for option in p.options} for p in choices}
        return free | {p.name: {o: float(o == fixed[p.name]) for o in p.options} for p in choices if p.name in fixed}

    def _candidate(self, x: Float[np.ndarray, " d"], fixed: Params) -> Candidate:
        params = self.generator.space.replace(self.generator.space.decode(x[:-VIEW_NUMBERS]), fixed)
        return Candidate(params, decode_view(x[-VIEW_NUMBERS:]))

    def _points(self, candidates: list[Candidate]) -> Float[np.ndarray, "n d"]:
        space = self.generator.space
        points = [np.r_[space.encode(c.params), encode_view(c.view)] for c in candidates]
        return np.array(points).reshape(len(candidates), len(space) + VIEW_NUMBERS)
