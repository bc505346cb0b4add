"""Corrections that the network itself suggests: what it reads from a candidate's render, against the picture.

An estimate is drawn towards the usual and has habits. Both show in what the network makes of a render whose parameters
are known, so the difference of the two readings says where to go: indirect inference (Gouriéroux et al. 1993).
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from dipcg.camera import VIEW_NUMBERS, View, decode_view, encode_view
from dipcg.images import MARGIN
from dipcg.model.estimators import PaperEstimator
from dipcg.pipeline import Candidate, Estimate, Inverter
from dipcg.render import Renderer
from dipcg.space import Params

STEPS = (1.0, 0.5, 1.0, 1.0)  # shares of the correction; from the third on, of a random half of the parameters


class Corrector:
    """Suggests parameters and a camera nearer to the picture than those of a built candidate."""

    def __init__(self, estimate: Estimate, rng: np.random.Generator) -> None:
        self.inverter, self.space, self.kept = estimate.inverter, estimate.inverter.generator.space, estimate.kept
        self.rng, self.renderer = rng, Renderer(self.inverter.image_size)
        self._wanted = read(self.inverter, estimate.image)

    def close(self) -> None:
        """Free the renderer."""
        self.renderer.close()

    def suggest(self, candidate: Candidate) -> list[tuple[Params, View]]:
        """Four ways to go on from a built candidate; choices and what is held stay."""
        assert candidate.mesh is not None
        x = np.r_[self.space.encode(candidate.params), encode_view(candidate.view)]
        seen = self.renderer.render(candidate.mesh, candidate.view, margin=MARGIN)
        correction = self._wanted - read(self.inverter, seen)
        correction[self.space.choices] = 0
        return [self._decode(x + share * part * correction) for share, part in zip(STEPS, self._parts(x), strict=True)]

    def _parts(self, x: Float[np.ndarray, " d"]) -> Bool[np.ndarray, "4 d"]:
        parts = self.rng.random((len(STEPS), len(x))) < 0.5
        parts[:2] = True
        return parts

    def _decode(self, x: Float[np.ndarray, " d"]) -> tuple[Params, View]:
        params = self.space.decode(x[:-VIEW_NUMBERS].clip(-1, 1))
        return self.space.replace(params, self.kept), decode_view(x[-VIEW_NUMBERS:])


def can_correct(estimate: Estimate) -> bool:
    """Whether the network makes a direct guess at pictures of one size: the paper's does not."""
    side = estimate.inverter.image_size
    return not isinstance(estimate.inverter.model, PaperEstimator) and estimate.image.shape[:2] == (side, side)


@torch.inference_mode()
def read(inverter: Inverter, image: UInt8[np.ndarray, "s s 4"]) -> Float[np.ndarray, " d"]:
    """What the network expects of a prepared picture at first sight, as x with the camera's numbers."""
    return inverter.model.first_guess(inverter.features(image)).mean[0].double().numpy()
