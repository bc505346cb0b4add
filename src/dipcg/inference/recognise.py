"""Which generator makes what a picture shows: at first sight, or by letting each estimator try.

Between the shipped generators a classifier decides (`classifier.py`). Where others are asked too, each estimates, and the
one whose best candidate matches best is the likeliest.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from functools import cache

import numpy as np

from dipcg.generators import load_generator
from dipcg.images import Source, load_image
from dipcg.inference.classifier import ENCODER, Classifier, among, load_classifier
from dipcg.inference.rank import rank, warning
from dipcg.model.zoo import CheckpointError, shipped
from dipcg.pipeline import Estimate, Inverter

TRIED = 4  # candidates of each generator
DOUBTED = 0.6  # strangeness above which a picture is doubted; see docs/results.md
USUAL = 0.25  # misfit of what a generator can make
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
    classifier = load_classifier(asked[ENCODER]) if ENCODER in asked else None
    if classifier is None or not asked.keys() <= set(classifier.names):
        return None
    return list(among(classifier.classify(image, asked[ENCODER]), asked).items())


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
    """A sentence when a picture seems to show nothing that the generator makes."""
    ours = estimate.inverter.generator.name
    seen = at_a_glance(estimate) or {ours: 1.0}
    likeliest, chance = next(iter(seen.items()))
    if likeliest != ours and strangeness(estimate.misfit, seen[ours]) > DOUBTED:
        return f"it looks more like a {likeliest} ({100 * chance:.0f} %) than a {ours}; try {likeliest!r}."
    return warning(estimate)


def strangeness(misfit: float | None, chance: float) -> float:
    """From 0 to 1: the mean of the misfit and of what a generator's chance at first sight lacks of 1.

    Each of the two alone errs where the other does not: a camera that may move makes other things fit, and a classifier
    has no name for what is none of its classes. An estimate that was not ranked counts as fitting as usual.
    """
    return ((USUAL if misfit is None else misfit) + 1 - chance) / 2


def at_a_glance(estimate: Estimate) -> dict[str, float]:
    """The chance of each kind, the likeliest first; nothing where no classifier knows the generator."""
    classifier = None if estimate.background == "words" else _classifier()
    if classifier is None or estimate.inverter.generator.name not in classifier[0].names:
        return {}
    found, inverter = classifier
    return found.classify(estimate.image, inverter)


@cache
def _classifier() -> tuple[Classifier, Inverter] | None:
    """The classifier that ships with the estimator whose encoder it needs, if they are there and fit."""
    try:
        inverter = Inverter.load(ENCODER)
    except (LookupError, CheckpointError):
        return None
    classifier = load_classifier(inverter)
    return (classifier, inverter) if classifier else None


def chances(agreements: Mapping[str, float]) -> list[tuple[str, float]]:
    """A softmax of the agreements over `TEMPERATURE`, the likeliest first."""
    weights = np.exp((np.array(list(agreements.values())) - max(agreements.values())) / TEMPERATURE)
    shares = (weights / weights.sum()).tolist()
    return sorted(zip(agreements, shares, strict=True), key=lambda pair: -pair[1])


def _agreement(inverter: Inverter, image: Source, candidates: int) -> float:
    best = rank(inverter.estimate(image, candidates)).candidates[0].agreement
    return 0.0 if best is None else best
