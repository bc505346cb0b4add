"""What an estimate is: candidates, probabilities and spreads, as plain data that can be stored, sent and compared."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import UInt8

from dipcg.camera import View
from dipcg.images import Background
from dipcg.materials import Colour
from dipcg.mesh import Mesh
from dipcg.space import Params, Value

# What an estimate was made from: a picture that was cut out of one of three kinds of background, lines, or a sentence.
Seen = Background | Literal["drawing", "words"]


@dataclass(frozen=True)
class Candidate:
    """One object that the picture may show: parameters and the camera that saw them.

    `agreement`, from 0 to 1, says how well its render matches the picture. It and the light `mesh` are None until
    `rank` has built the candidate, and when it cannot be built. `assumed` are options that were fixed to make it.
    """

    params: Params
    view: View
    agreement: float | None = None
    mesh: Mesh | None = None
    assumed: Params = field(default_factory=dict)


class Step(NamedTuple):
    """How far a search is: seconds and builds since its start, and the misfit of the best candidate so far."""

    seconds: float
    builds: int
    misfit: float


@dataclass(frozen=True)
class Estimate:
    """What a picture shows, as plain data: the expected candidate, then the others, the most central first.

    The others are samples and, of each choice that is doubtful, expected candidates with another option assumed.

    `image` shows the cut-out object, at most 256 pixels a side whatever size the encoder takes. `ground` is the colour
    that it was cut out of, in sRGB from 0 to 1, where it was plain and is known. `generator` is a name, `ref` that name
    or a file, as `load_generator` reads it. `spread` has for each parameter the standard deviation over the samples
    (reals, in natural units) or the share of samples that agree with the expected candidate (choices); it is empty when
    there are no samples. `probabilities` has those of the options of each choice, where the choice is active.
    `expected` is the expected candidate whatever the order, `fixed` the values that were fixed. `misfit`, from 0 to 1
    and None before ranking, is 1 minus the best agreement; `trace` says how `refine` lowered it.
    """

    generator: str
    ref: str
    candidates: list[Candidate]
    spread: dict[str, float]
    probabilities: dict[str, dict[Value, float]]
    image: UInt8[np.ndarray, "s s 4"]
    background: Seen
    expected: Candidate
    fixed: Params = field(default_factory=dict)
    ground: Colour | None = None
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
