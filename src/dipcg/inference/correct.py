"""Corrections that the network itself suggests: its guess from the picture against its guess from a candidate's render.

A guess is biased, towards typical values and otherwise. The bias shows in the guess from a render, whose parameters are
those of the candidate, so the difference of both guesses says where to go: indirect inference (Gouriéroux et al. 1993).
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from dipcg.camera import VIEW_NUMBERS, View, decode_view, encode_view
from dipcg.images import MARGIN, crop_to_object
from dipcg.pipeline import Candidate, Estimate, Inverter
from dipcg.render import Renderer
from dipcg.space import Params

# Shares of the correction that are tried; the last two are of a random half of the parameters.
STEPS = (1.0, 0.5, 1.0, 1.0)


class Corrector:
    """Suggests parameters and a camera nearer to the picture than those of a built candidate."""

    def __init__(self, estimate: Estimate, inverter: Inverter, rng: np.random.Generator) -> None:
        self.inverter, self.space, self.fixed = inverter, inverter.generator.space, estimate.fixed
        self.rng, self.renderer = rng, Renderer(inverter.image_size)
        self._target = first_guess(inverter, crop_to_object(estimate.image, inverter.image_size))

    def close(self) -> None:
        """Free the renderer."""
        self.renderer.close()

    def suggest(self, candidate: Candidate) -> list[tuple[Params, View]]:
        """Four corrections of a built candidate; its choices and the fixed values stay."""
        assert candidate.mesh is not None
        x = np.r_[self.space.encode(candidate.params), encode_view(candidate.view)]
        seen = self.renderer.render(candidate.mesh, candidate.view, margin=MARGIN)
        correction = self._target - first_guess(self.inverter, seen)
        correction[self.space.choices] = 0
        return [self._decode(x + share * part * correction) for share, part in zip(STEPS, self._parts(x), strict=True)]

    def _parts(self, x: Float[np.ndarray, " d"]) -> Bool[np.ndarray, "4 d"]:
        parts = self.rng.random((len(STEPS), len(x))) < 0.5
        parts[:2] = True
        return parts

    def _decode(self, x: Float[np.ndarray, " d"]) -> tuple[Params, View]:
        params = self.space.decode(x[:-VIEW_NUMBERS].clip(-1, 1))
        return self.space.replace(params, self.fixed), decode_view(x[-VIEW_NUMBERS:])


@torch.inference_mode()
def first_guess(inverter: Inverter, image: UInt8[np.ndarray, "s s 4"]) -> Float[np.ndarray, " d"]:
    """The direct guess from a picture that is cropped to the encoder's size, as x with the camera's numbers."""
    return inverter.model.first_guess(inverter.features(image)).mean[0].double().numpy()
