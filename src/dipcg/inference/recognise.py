"""Which generator makes what a picture shows, and whether any of them does.

Among the generators that ship, the classifier decides (`classifier.py`). Where others take part too, each estimates a
few candidates, and the one whose best candidate agrees best with the picture is the likeliest.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dipcg.images import Cutout, Source, cut_out
from dipcg.inference.classifier import among
from dipcg.inference.rank import rank
from dipcg.pipeline import Estimate, Inverter

# Candidates of each generator where all of them try.
TRIED = 4
# Of agreement: the difference that makes one generator e times as likely as another. Measured, as the thresholds below,
# in docs/experiments/recognition.md.
TEMPERATURE = 0.03
# The out-of-distribution thresholds: of the misfit alone, and of its mean with what the class probability lacks of 1.
OUT_OF_DISTRIBUTION_MISFIT = 0.55
OUT_OF_DISTRIBUTION_SCORE = 0.6
# The misfit of objects that a generator can make.
TYPICAL_MISFIT = 0.25


def recognise(
    picture: Source | Cutout,
    inverters: Mapping[str, Inverter],
    classes: Mapping[str, float] | None = None,
    candidates: int = TRIED,
) -> dict[str, float]:
    """The probability that each generator makes what the picture shows, the likeliest first.

    `classes` are the probabilities of the classifier, which are used where it knows all the generators. Raises
    images.ImageError for a picture that cannot be used.
    """
    if classes and inverters.keys() <= classes.keys():
        return among(classes, inverters)
    cutout = cut_out(picture)
    return softmax({name: _agreement(inverter, cutout, candidates) for name, inverter in inverters.items()})


def doubt(estimate: Estimate, classes: Mapping[str, float] | None = None) -> str | None:
    """A sentence when the picture seems to show nothing that the generator makes.

    `classes` are the probabilities of the classifier for the picture.
    """
    own = estimate.generator
    if classes and own in classes:
        likeliest, probability = next(iter(classes.items()))
        score = out_of_distribution_score(estimate.misfit, classes[own])
        if likeliest != own and score > OUT_OF_DISTRIBUTION_SCORE:
            return f"it looks more like a {likeliest} ({100 * probability:.0f} %) than a {own}; try {likeliest!r}."
    return poor_fit(estimate)


def poor_fit(estimate: Estimate) -> str | None:
    """A sentence when even the best candidate agrees with the picture too little."""
    if estimate.misfit is None or estimate.misfit <= OUT_OF_DISTRIBUTION_MISFIT:
        return None
    name = estimate.generator
    return (
        f"the best {name} found agrees with the picture by only {100 * (1 - estimate.misfit):.0f} %; "
        f"perhaps it shows nothing that {name!r} can make."
    )


def out_of_distribution_score(misfit: float | None, probability: float) -> float:
    """From 0 to 1: the mean of the misfit and of what the class probability of the generator lacks of 1.

    Each of the two alone errs where the other does not: a camera that may move makes other objects fit, and the
    classifier has no class for an object of no generator. An estimate that was not ranked has a typical misfit.
    """
    return ((TYPICAL_MISFIT if misfit is None else misfit) + 1 - probability) / 2


def softmax(agreements: Mapping[str, float]) -> dict[str, float]:
    """A softmax of the agreements over `TEMPERATURE`, the likeliest first."""
    weights = np.exp((np.array(list(agreements.values())) - max(agreements.values())) / TEMPERATURE)
    shares = (weights / weights.sum()).tolist()
    return dict(sorted(zip(agreements, shares, strict=True), key=lambda pair: -pair[1]))


def _agreement(inverter: Inverter, picture: Cutout, candidates: int) -> float:
    best = rank(inverter.estimate(picture, candidates), inverter).candidates[0].agreement
    return 0.0 if best is None else best
