"""From a picture or a sentence to a result: the one workflow of the command line, the app and the HTTP API.

Recognise the generator, estimate its parameters, rank the candidates or search on from the best, and say what is
doubtful. A picture is cut out once, and no network is loaded twice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from dipcg.images import Cutout, Source, cut_out
from dipcg.inference.again import look_again
from dipcg.inference.classifier import among
from dipcg.inference.inverters import Inverters
from dipcg.inference.rank import rank
from dipcg.inference.recognise import doubt, recognise
from dipcg.inference.recognise_text import recognise_text
from dipcg.inference.refine import refine
from dipcg.pipeline import Estimate, Inverter

# Called with the share of the work that is done, and with a note that says what is done next.
Report = Callable[[float, str], None]


def _report_nothing(share: float, note: str) -> None:
    pass


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to estimate."""

    generator: str | None = None
    """the name of the generator; recognised when None"""
    candidates: int = 16
    """the number of candidates: the expected one, and samples"""
    steps: int | None = None
    """of the sampler; as many as the checkpoint was made for when None"""
    seed: int = 0
    """random seed of the samples"""
    fixed: Mapping[str, Any] = field(default_factory=dict)
    """values of parameters, around which the rest is estimated"""
    rank: bool = True
    """build all candidates, put first the one that is chosen by its agreement with the picture, and correct it once"""
    refine_s: float | None = None
    """seconds to search on from the best candidate; no search when None"""


@dataclass(frozen=True)
class Result:
    """An estimate, which generator it is of, and what is doubtful about it; plain data."""

    estimate: Estimate
    probabilities: dict[str, float] = field(default_factory=dict)
    """of the generators that were considered, the likeliest first; empty when one was named"""
    doubt: str | None = None
    """a sentence when the picture seems to show nothing that the generator makes"""
    view_doubts: list[str | None] = field(default_factory=list)
    """the same for each further picture, which may show another object"""
    classes: dict[str, float] = field(default_factory=dict)
    """of all generators that the classifier knows, its probabilities for the picture"""
    notes: tuple[str, ...] = ()
    """sentences about the pictures: of which frame or piece was taken, where there are several"""


def estimate(
    source: Source | Cutout | Sequence[Source | Cutout],
    inverters: Inverters,
    options: Options = Options(),
    report: Report = _report_nothing,
) -> Result:
    """Estimate what a picture shows, or several pictures in a list that show one object, each from its own side.

    Raises images.ImageError for a picture that cannot be used, and ValueError for options that cannot be used.
    """
    pictures: Sequence[Any] = source if isinstance(source, (list, tuple)) else [source]
    if not pictures:
        raise ValueError("Give at least one picture.")
    report(0.05, "Looking at the picture")
    views = [cut_out(picture) for picture in pictures]
    found = look(views, inverters, options, report)
    inverter = inverters[found.estimate.generator]
    result = ranked(found, _rank(found.estimate, inverter, options, report, looks_again=len(views) == 1))
    view_doubts = [_doubt_view(view, result.estimate, inverter, inverters, options) for view in views[1:]]
    return replace(result, view_doubts=view_doubts)


def look(views: Sequence[Cutout], inverters: Inverters, options: Options, report: Report = _report_nothing) -> Result:
    """The part of `estimate` before the ranking: recognise the generator, and estimate with the network."""
    classes = inverters.classify(views[0])
    probabilities = _recognise(inverters, options, lambda: recognise(views[0], inverters, classes))
    inverter = inverters.find(options.generator or next(iter(probabilities)))
    report(0.1, "Estimating the parameters")
    found = inverter.estimate_views(views, options.candidates, options.steps, options.seed, options.fixed)
    notes = tuple(note for view in views for note in view.notes)
    return ranked(Result(found, probabilities, classes=classes, notes=notes), found)


def look_at_many(asked: Sequence[tuple[Cutout, Options]], inverters: Inverters) -> list[Result | None]:
    """As `look` for several objects, each from its own picture, in one pass of the network for each generator.

    None stands for a picture whose generator the network alone does not recognise. Raises what `estimate` does.
    """
    many_classes = inverters.classify_many([picture for picture, _ in asked])
    results: list[Result | None] = [None] * len(asked)
    groups: dict[tuple[str, int, int | None], list[tuple[int, dict[str, float]]]] = {}
    for i, ((_, options), classes) in enumerate(zip(asked, many_classes, strict=True)):
        if options.generator or len(inverters) == 1 or inverters.keys() <= classes.keys():
            probabilities = _recognise(inverters, options, lambda classes=classes: among(classes, inverters))
            name = options.generator or next(iter(probabilities))
            groups.setdefault((name, options.candidates, options.steps), []).append((i, probabilities))
    for (name, candidates, steps), members in groups.items():
        pictures = [(asked[i][0], asked[i][1].seed, asked[i][1].fixed) for i, _ in members]
        found = inverters.find(name).estimate_many(pictures, candidates, steps)
        for (i, probabilities), one in zip(members, found, strict=True):
            results[i] = ranked(Result(one, probabilities, classes=many_classes[i], notes=asked[i][0].notes), one)
    return results


def ranked(result: Result, estimate: Estimate) -> Result:
    """The result with the estimate after ranking, and with what is doubtful about that."""
    return replace(result, estimate=estimate, doubt=doubt(estimate, result.classes))


def describe(text: str, inverters: Inverters, options: Options = Options(), report: Report = _report_nothing) -> Result:
    """Estimate what a sentence describes; `inverters` are those that read text. There is no picture to rank by.

    Raises ValueError for a text or for options that cannot be used.
    """
    report(0.05, "Reading your words")
    probabilities = _recognise(inverters, options, lambda: recognise_text(text, inverters))
    inverter = inverters.find(options.generator or next(iter(probabilities)))
    report(0.1, "Estimating the parameters")
    return Result(
        inverter.describe(text, options.candidates, options.steps, options.seed, options.fixed), probabilities
    )


def _recognise(inverters: Inverters, options: Options, recognise: Callable[[], dict[str, float]]) -> dict[str, float]:
    """The probabilities of the generators; there is nothing to recognise when one is named, or there is only one."""
    if options.generator:
        return {}
    return dict.fromkeys(inverters, 1.0) if len(inverters) == 1 else recognise()


def _rank(unranked: Estimate, inverter: Inverter, options: Options, report: Report, looks_again: bool) -> Estimate:
    """The estimate ranked or refined, as the options say.

    A second look would see the first picture alone, so there is none where several pictures show the object.
    """
    if (seconds := options.refine_s) is not None:
        return refine(
            unranked, inverter, seconds, lambda step: report(step.seconds / seconds, f"misfit {step.misfit:.3f}")
        )
    if options.rank:
        count, words = len(unranked.candidates), "Building and comparing the candidates"
        ordered = rank(unranked, inverter, lambda n: report(0.3 + 0.6 * n / count, words))
        return look_again(ordered, inverter) if looks_again else ordered
    return unranked


def _doubt_view(
    view: Cutout, ranked: Estimate, inverter: Inverter, inverters: Inverters, options: Options
) -> str | None:
    """Whether a further picture shows the same object: only its camera is estimated, and then it is compared."""
    space, params = inverter.generator.space, ranked.params
    fixed = {name: params[name] for name in space.names if space.is_active(name, params)}
    return doubt(
        rank(inverter.estimate(view, 2, options.steps, options.seed, fixed), inverter), inverters.classify(view)
    )
