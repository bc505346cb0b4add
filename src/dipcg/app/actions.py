"""What visitors and programs ask for, as plain functions of the studio: a result, or a sentence in an exception."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from shutil import make_archive, rmtree
from typing import Any

import numpy as np
from jaxtyping import UInt8

from dipcg.app import state as app_work
from dipcg.app.cutout import Correction, corrected
from dipcg.app.service import CANDIDATES, Studio
from dipcg.app.session import Change
from dipcg.app.state import Asked, Work
from dipcg.app.viewer import data_url, scene
from dipcg.export.asset import FORMATS, NEEDS
from dipcg.generators import Detail
from dipcg.images import Source, crop_to_object, cut_out
from dipcg.inference.estimate import Options, Report, Result
from dipcg.inference.serialise import to_dict
from dipcg.pipeline import Estimate

KEPT_S = 3600.0  # seconds that a written file stays
PARAMETERS = ".json"

Strip = dict[str, Any]
Image = UInt8[np.ndarray, "h w 4"]


def estimate(
    studio: Studio, asked: Asked, generator: str, fixed: Mapping[str, Any], seed: int, report: Report
) -> tuple[Change, Strip]:
    """Estimate from a picture or from words: the change that opens the best, and the strip of candidates.

    An empty `generator` lets it choose. Raises what `Studio.estimate` and `Studio.describe` do.
    """
    options = Options(generator=generator or None, candidates=studio.candidates, seed=seed, fixed=fixed)
    work: Any = studio.describe if isinstance(asked, str) else studio.estimate
    result: Result = work(asked, options, report)
    fresh = app_work.estimated(result.estimate, asked, frozenset(fixed))
    return lambda work: app_work.replaced(work, fresh), strip(studio, result.estimate) | {"note": note(result)}


def strip(studio: Studio, found: Estimate) -> Strip:
    """The picture as the model saw it and the candidates from their own cameras, for page/strip.js."""
    seen = [(candidate.mesh, candidate.view) for candidate in found.candidates if candidate.mesh is not None]
    labels = [_label(candidate.agreement) for candidate in found.candidates]
    images = [data_url(tile) for tile in studio.tiles(seen)]
    candidates = [
        {"image": image, "label": words, "description": f"Candidate {number}"}
        for number, (image, words) in enumerate(zip(images, labels, strict=True), 1)
    ]
    picture = {} if found.background == "words" else {"picture": data_url(crop_to_object(found.image, 256))}
    return picture | {"candidates": candidates}


def note(result: Result) -> str:
    """A sentence or two about the result for the page."""
    likeliest = next(iter(result.probabilities.items()), ("", 1.0))
    which = f"Recognised as {likeliest[0]} ({100 * likeliest[1]:.0f} % sure). " if len(result.probabilities) > 1 else ""
    count = len(result.estimate.candidates)
    many = f"{count} different candidates, the likeliest first." if count > 1 else "All candidates are alike."
    return which + (f"Careful: {result.doubt}" if result.doubt else many)


def view_of(studio: Studio, work: Work) -> dict[str, Any] | None:
    """The open asset for page/viewer.js, built in light detail; raises worker.BuildError."""
    if not work.params:
        return None
    view = work.candidates[work.chosen].view if work.chosen >= 0 else None
    return scene(studio.build(work.generator, work.params).mesh, view, work.opened)


def write(studio: Studio, folder: Path, generator: str, params: object, suffix: str, detail: Detail = "full") -> Path:
    """Build and write an asset, or its parameters, into a new folder of `folder`.

    Older ones are deleted first. Raises ValueError with a sentence for wrong parameters or an unknown format.
    """
    if suffix not in endings():
        raise ValueError(f"There is no format {suffix!r}; use one of {', '.join(endings())}.")
    ref, space = studio.find(generator).generator.ref, studio.find(generator).generator.space
    checked = space.validate(_named_values(params))
    sweep(folder, KEPT_S)
    target = Path(tempfile.mkdtemp(dir=folder)) / f"{generator}{suffix}"
    if suffix == PARAMETERS:
        from dipcg.space import params_to_json

        target.write_text(params_to_json(checked, ref))
        return target
    studio.build(generator, checked, detail).export(target)
    return _one_file(target)


def endings() -> list[str]:
    """The formats that can be written here, the parameters' last."""
    return [*(suffix for suffix in FORMATS if suffix not in NEEDS or find_spec(NEEDS[suffix][0])), PARAMETERS]


def sweep(folder: Path, older_than_s: float) -> None:
    """Delete the folders of files that were written longer ago than this."""
    for made in folder.iterdir():
        if time.time() - made.stat().st_mtime > older_than_s:
            rmtree(made, ignore_errors=True)


def answer_estimate(
    studio: Studio, picture: Source, generator: str = "", candidates: int = CANDIDATES, seed: int = 0,
    keep: object = None,
) -> dict[str, Any]:  # fmt: skip
    """What a program gets for a picture: candidates with parameters, view and agreement, and how sure each thing is."""
    return _plain(studio.estimate(picture, _options(generator, candidates, seed, keep)))


def answer_describe(
    studio: Studio, text: str, generator: str = "", candidates: int = CANDIDATES, seed: int = 0, keep: object = None
) -> dict[str, Any]:
    """What a program gets for a sentence: as for a picture, without agreement and misfit."""
    return _plain(studio.describe(text, _options(generator, candidates, seed, keep)))


def _options(generator: str, candidates: int, seed: int, keep: object) -> Options:
    fixed = _named_values(keep or {})
    return Options(generator=generator or None, candidates=candidates, seed=seed, fixed=fixed)


def _plain(result: Result) -> dict[str, Any]:
    """The result ready for JSON; a generator that the request names has the probability 1."""
    return to_dict(result) | {"generators": result.probabilities or {result.estimate.generator: 1.0}}


def answer_cut_out(picture: Source, difference: float | int | None = None) -> Image:
    """What a program gets for a picture: the object, cut out by its `difference` from the border's colour if given."""
    how = Correction() if difference is None else Correction("by colour", float(difference))
    return cut_out(corrected(picture, how)).image


def answer_generators(studio: Studio) -> list[dict[str, Any]]:
    """The generators that can be asked for, with their parameters."""
    return [{"name": name, "parameters": i.generator.space.describe()} for name, i in studio.inverters.items()]


def command(studio: Studio, work: Work) -> str:
    """The command line that makes the open asset again."""
    if not work.params:
        return ""
    generator = studio.find(work.generator).generator
    return app_work.command(generator.ref, generator.space, work.params, f"{generator.name}.glb")


def _one_file(target: Path) -> Path:
    """The written file, or an archive when others were written beside it, as an OBJ's materials are."""
    if len(list(target.parent.iterdir())) == 1:
        return target
    outside = Path(tempfile.mkdtemp(dir=target.parent.parent))
    return Path(make_archive(str(outside / target.stem), "zip", target.parent))


def _label(agreement: float | None) -> str:
    return "" if agreement is None else f"{100 * agreement:.0f} % match"


def _named_values(given: object) -> dict[str, Any]:
    if not isinstance(given, Mapping):
        raise ValueError(f'Parameters are an object like {{"width": 0.5}}, got {type(given).__name__}.')
    return {str(name): value for name, value in given.items()}
