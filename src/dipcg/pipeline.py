"""From a picture to an editable asset: the file to read first.

image -> tokens -> x -> params -> mesh
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from dipcg.camera import VIEW_NUMBERS, decode_view, encode_view
from dipcg.encoders import Features, encoder_input
from dipcg.export.asset import Asset
from dipcg.generators import Detail, Generator
from dipcg.images import Cutout, Source, cut_out
from dipcg.materials import Colour
from dipcg.model.alternatives import alternatives
from dipcg.model.checkpoint import load_checkpoint
from dipcg.model.constraints import check_fixed, encode_all_fixed, needed_options
from dipcg.model.estimators import AnyEstimator
from dipcg.model.posterior import Posterior
from dipcg.model.uncertainty import calibrated, central_first, spread
from dipcg.model.zoo import find_checkpoint
from dipcg.results import Candidate, Estimate, Seen, Step
from dipcg.space import Choice, Params, Value
from dipcg.workers.pool import BuildPool

__all__ = ["Candidate", "Estimate", "Inverter", "Step"]

# The picture of an estimate from text.
NO_PICTURE = np.zeros((128, 128, 4), np.uint8)
# Draws of noise over which the expected candidate is averaged.
EXPECTED_OVER = 8

Probabilities = dict[str, dict[Value, float]]


class Asked(NamedTuple):
    """One estimate that is asked for: its picture, the seed of its noise, and the values that are fixed."""

    picture: UInt8[np.ndarray, "s s 4"]
    background: Seen
    ground: Colour | None
    seed: int
    fixed: Mapping[str, Any]


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
        cutouts = [self._cut_out(image) for image in images]
        return self._estimate(self._see(cutouts), [_asked(cutouts[0], seed, fixed or {})], candidates, steps)[0]

    @torch.inference_mode()
    def estimate_many(
        self, pictures: Sequence[tuple[Cutout, int, Mapping[str, Any]]], candidates: int = 16, steps: int | None = None
    ) -> list[Estimate]:
        """Estimate several objects together, each from its own picture, with its own seed and fixed values.

        One pass of the network is faster than one for each. Raises what `estimate` does.
        """
        cutouts = [self._cut_out(picture) for picture, _, _ in pictures]
        asked = [_asked(cutout, seed, fixed) for cutout, (_, seed, fixed) in zip(cutouts, pictures, strict=True)]
        return self._estimate(self._see(cutouts), asked, candidates, steps)

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
        return self._estimate(features, [Asked(NO_PICTURE, "words", None, seed, fixed or {})], candidates, steps)[0]

    @torch.inference_mode()
    def guess(self, image: Source | Cutout) -> Candidate:
        """The direct regression from the picture's summary, without the denoiser; raises images.ImageError."""
        guess = self.model.outputs.modes(self.model.first_guess(self._see([self._cut_out(image)])))
        return self._candidate(guess[0].double().numpy(), {})

    def features(self, *pictures: UInt8[np.ndarray, "s s 4"]) -> Features:
        """The encoder's features of pictures that are cropped to its size, a row for each."""
        return self.model.encoder(torch.cat([encoder_input(picture) for picture in pictures]))

    def build(self, params: Params, detail: Detail = "standard") -> Asset:
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

    def _cut_out(self, image: Source | Cutout) -> Cutout:
        if not self.image_size:
            raise ValueError("This checkpoint reads words, not pictures; give it a text.")
        return cut_out(image)

    def _see(self, cutouts: Sequence[Cutout]) -> Features:
        return self.features(*(cutout.crop(self.image_size) for cutout in cutouts))

    def _estimate(
        self, features: Features, asked: Sequence[Asked], candidates: int, steps: int | None
    ) -> list[Estimate]:
        """An estimate for each that was asked for; `features` has a row for each, or several for the only one."""
        steps = self.model.config.steps if steps is None else steps
        if min(candidates, steps) < 1:
            raise ValueError(f"candidates and steps must be at least 1, got {candidates} and {steps}.")
        views = len(features.summary) // len(asked)
        posterior = Posterior(self.model, self.model.condition(features), len(asked), views)
        size = (EXPECTED_OVER + candidates - 1, len(self.generator.space) + VIEW_NUMBERS)
        normal = np.stack([np.random.default_rng(one.seed).standard_normal(size) for one in asked])
        noise = torch.from_numpy(normal).float()
        values = [self._fix_needed(one.fixed, posterior.of(i), noise[i, :EXPECTED_OVER]) for i, one in enumerate(asked)]
        fixed = encode_all_fixed(self.generator.space, values, VIEW_NUMBERS)
        mean = posterior.expect(noise[:, :EXPECTED_OVER], fixed)
        modes, drawn = posterior.modes(mean, fixed), np.empty((len(asked), 0, noise.shape[-1]))
        if candidates > 1:
            samples = posterior.draw(noise[:, EXPECTED_OVER:], steps, fixed)
            drawn = posterior.modes(samples, fixed).reshape(len(asked), candidates - 1, -1)
        probabilities = [self._probabilities(*row) for row in zip(mean.logits.exp(), values, strict=True)]
        estimates = []
        for i, one in enumerate(asked):
            few = noise[i, :EXPECTED_OVER]
            others = self._assume(modes[i], values[i], probabilities[i], (candidates - 1) // 2, posterior.of(i), few)
            samples = drawn[i][: candidates - 1 - len(others)]
            estimates.append(self._as_estimate(one, values[i], modes[i], samples, others, probabilities[i]))
        return estimates

    def _assume(
        self,
        mode: Float[np.ndarray, " d"],
        fixed: Params,
        probabilities: Probabilities,
        most: int,
        posterior: Posterior,
        noise: Float[Tensor, "n d"],
    ) -> list[Candidate]:
        """The expected candidates with another option assumed where the choice is doubtful."""
        found, space = [], self.generator.space
        if self.model.config.expecting_steps > 1:
            # An expectation that is known at the last step alone would cost as much as all samples.
            return found
        for options in alternatives(space, self._candidate(mode, fixed).params, probabilities, fixed)[:most]:
            values = self._fix_needed(fixed | options, posterior, noise)
            entries = encode_all_fixed(space, [values], VIEW_NUMBERS)
            x = posterior.modes(posterior.expect(noise[None], entries), entries)[0]
            found.append(replace(self._candidate(x, values), assumed=options))
        return found

    def _as_estimate(
        self,
        asked: Asked,
        fixed: Params,
        mode: Float[np.ndarray, " d"],
        drawn: Float[np.ndarray, "k d"],
        others: Sequence[Candidate],
        probabilities: Probabilities,
    ) -> Estimate:
        space, free = self.generator.space, ~self.model.outputs.is_choice.numpy()
        free[[space.names.index(name) for name in fixed]] = False
        expected = self._candidate(mode, fixed)
        drawn = calibrated(drawn, mode, self.model.config.calibration_scale, free)
        samples = [self._candidate(x, fixed) for x in drawn]
        rest = [*samples, *others]
        points = [np.r_[space.encode(c.params), encode_view(c.view)] for c in rest]
        return Estimate(
            generator=self.generator.name,
            ref=self.generator.ref,
            candidates=[expected, *(rest[i] for i in central_first(np.reshape(points, (len(rest), len(mode)))))],
            spread=spread(space, expected.params, [c.params for c in samples]) if samples else {},
            probabilities=probabilities,
            image=asked.picture,
            background=asked.background,
            ground=asked.ground,
            expected=expected,
            fixed=fixed,
        )

    def _fix_needed(self, fixed: Mapping[str, Any], posterior: Posterior, noise: Float[Tensor, "n d"]) -> Params:
        """The fixed values, and each choice without which one of them does nothing, at its likeliest fitting option."""
        values = check_fixed(self.generator.space, fixed)
        options = needed_options(self.generator.space, values)
        if not options:
            return values
        expected = posterior.expect(noise[None], encode_all_fixed(self.generator.space, [values], VIEW_NUMBERS))
        probabilities = self._probabilities(expected.logits.exp()[0], values)
        return values | {name: max(fitting, key=probabilities[name].__getitem__) for name, fitting in options.items()}

    def _probabilities(self, of_options: Tensor, fixed: Params) -> Probabilities:
        shares = iter(of_options.tolist())
        choices = [p for p in self.generator.space if isinstance(p, Choice)]
        free = {p.name: {option: next(shares) for option in p.options} for p in choices}
        return free | {p.name: {o: float(o == fixed[p.name]) for o in p.options} for p in choices if p.name in fixed}

    def _candidate(self, x: Float[np.ndarray, " d"], fixed: Params) -> Candidate:
        params = self.generator.space.replace(self.generator.space.decode(x[:-VIEW_NUMBERS]), fixed)
        return Candidate(params, decode_view(x[-VIEW_NUMBERS:]))


def _asked(cutout: Cutout, seed: int, fixed: Mapping[str, Any]) -> Asked:
    background = "drawing" if cutout.is_drawing else cutout.background
    return Asked(cutout.picture, background, cutout.ground, seed, fixed)
