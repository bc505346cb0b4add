"""Which generator makes what a picture shows: at first sight, or by letting each estimator try.

Between the generators that ship a classifier decides (`kinds.py`). Where others are asked too, each estimates, and the
one whose best candidate matches best is the likeliest.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from functools import cache

import numpy as np

from dipcg.generators import load_generator
from dipcg.images import Source, load_image
from dipcg.kinds import ENCODER, Kinds, among, load_kinds
from dipcg.pipeline import Estimate, Inverter
from dipcg.rank import rank, warning
from dipcg.weights import CheckpointError, shipped

TRIED = 4  # candidates of each generator
SURE, UNLIKELY = 0.8, 0.05  # chances of another generator and of the one asked, from which there is a doubt
TEMPERATURE = 0.03  # of agreement: what makes one generator e times as likely as another; see docs/results.md


def recognise(
    image: Source, inverters: Mapping[str, Inverter] | None = None, candidates: int = TRIED
) -> list[tuple[str, float]]:
    """The generators with the chance that each makes what the picture shows, the likeliest first.

    Without `inverters` those that ship and can be built here are loaded. Raises images.ImageError for a picture that
    cannot be used and weights.CheckpointError when there is no estimator to ask.
    """
    picture = load_image(image)
    with ExitStack() as stack:
        asked = inverters or {name: stack.enter_context(Inverter.load(name)) for name in recognisable()}
        if found := _at_first_sight(asked, picture):
            return found
        agreements = {name: _agreement(inverter, picture, candidates) for name, inverter in asked.items()}
    return chances(agreements)


def _at_first_sight(asked: Mapping[str, Inverter], image: Source) -> list[tuple[str, float]] | None:
    """None where a generator is asked for that the classifier does not know, or its encoder is not there."""
    kinds = load_kinds(asked[ENCODER]) if ENCODER in asked else None
    if kinds is None or not asked.keys() <= set(kinds.names):
        return None
    return among(kinds.chances(asked[ENCODER], image), asked)


def recognisable() -> list[str]:
    """The generators with a checkpoint that can be built here; raises weights.CheckpointError when there is none."""
    names = [name for name in shipped() if not load_generator(name).missing]
    if not names:
        raise CheckpointError(
            "No generator with a trained checkpoint can be built here, so none can be recognised; "
            "run `dipcg doctor`, or name a folder with a checkpoint with -g."
        )
    return names


def doubt(estimate: Estimate) -> str | None:
    """A sentence when a picture seems to show nothing that the generator makes: by its misfit, or at first sight."""
    return warning(estimate) or _looks_like_another(estimate)


def _looks_like_another(estimate: Estimate) -> str | None:
    classifier = None if estimate.background == "words" else _classifier()
    ours = estimate.inverter.generator.name
    if classifier is None or ours not in classifier[0].names:
        return None
    kinds, inverter = classifier
    seen = kinds.chances(inverter, estimate.image)
    likeliest, chance = seen[0]
    if chance < SURE or dict(seen)[ours] > UNLIKELY:
        return None
    return f"it looks more like a {likeliest} ({100 * chance:.0f} %) than a {ours}; try {likeliest!r}."


@cache
def _classifier() -> tuple[Kinds, Inverter] | None:
    """The classifier that ships with the estimator whose encoder it needs, if they are there and fit."""
    try:
        inverter = Inverter.load(ENCODER)
    except (LookupError, CheckpointError):
        return None
    kinds = load_kinds(inverter)
    return (kinds, inverter) if kinds else None


def chances(agreements: Mapping[str, float]) -> list[tuple[str, float]]:
    """A softmax of the agreements over `TEMPERATURE`, the likeliest first."""
    weights = np.exp((np.array(list(agreements.values())) - max(agreements.values())) / TEMPERATURE)
    shares = (weights / weights.sum()).tolist()
    return sorted(zip(agreements, shares, strict=True), key=lambda pair: -pair[1])


def _agreement(inverter: Inverter, image: Source, candidates: int) -> float:
    best = rank(inverter.estimate(image, candidates)).candidates[0].agreement
    return 0.0 if best is None else best
