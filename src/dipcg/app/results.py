"""Candidates that are built and compared, and results as the API gives them."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from dipcg.app.pictures import data_url
from dipcg.app.studio import Studio
from dipcg.images import MARGIN
from dipcg.inference.again import improved
from dipcg.inference.colours import seen_colours
from dipcg.inference.estimate import Result, ranked
from dipcg.inference.preview import TEXT_VIEW
from dipcg.inference.rank import merge, order
from dipcg.inference.serialise import to_dict
from dipcg.materials import Colour, coloured, in_bytes
from dipcg.mesh import Mesh
from dipcg.pipeline import Candidate, Estimate
from dipcg.render import Renderer
from dipcg.workers.process import BuildError

# Side of a candidate's picture.
TILE = 256
_own = threading.local()

PartColours = dict[str, Colour]


@dataclass(frozen=True)
class Judged:
    """A result of candidates that are built, in order, with a picture of each as a data: URL and its colours."""

    result: Result
    thumbnails: list[str] | None
    colours: list[PartColours]


def judge(result: Result, built: Sequence[Mesh | BuildError], studio: Studio, thumbnails: bool) -> Judged:
    """Order the candidates; `built` has the mesh, or the error, of each that has no mesh yet. Others are left out."""
    space, estimate = studio.generator(result.estimate.generator).space, result.estimate
    meshes = iter(built)
    every = [next(meshes) if candidate.mesh is None else candidate.mesh for candidate in estimate.candidates]
    if estimate.background == "words":
        estimate = _seen_from_one_side(estimate, every, studio)
        estimate = replace(estimate, candidates=merge(estimate.candidates, space))
    elif any(isinstance(mesh, Mesh) for mesh in every):
        estimate = order(estimate, every, space)
    return _judged(result, estimate, thumbnails)


def improve(
    found: Judged, again: list[Candidate], built: Sequence[Mesh | BuildError], studio: Studio, thumbnails: bool
) -> Judged:
    """The judged result with the best of the first one's corrections before it, if it agrees better."""
    estimate = found.result.estimate
    better = improved(estimate, again, built, studio.generator(estimate.generator).space)
    return found if better is estimate else _judged(found.result, better, thumbnails)


def _judged(result: Result, estimate: Estimate, thumbnails: bool) -> Judged:
    shown = [candidate for candidate in estimate.candidates if candidate.mesh is not None]
    result = ranked(result, replace(estimate, candidates=shown))
    pictures = [thumbnail(candidate) for candidate in shown] if thumbnails else None
    return Judged(result, pictures, [_colours(estimate, candidate) for candidate in shown])


def thumbnail(candidate: Candidate) -> str:
    """The built candidate from its camera, as a data: URL."""
    assert candidate.mesh is not None
    return data_url(_renderer().render(candidate.mesh, candidate.view, margin=MARGIN))


def _colours(estimate: Estimate, candidate: Candidate) -> PartColours:
    """The colours of a built candidate's parts in its file, as a command can say them, if the picture shows any."""
    assert candidate.mesh is not None
    known = seen_colours(estimate, candidate.mesh, candidate.view)
    names = candidate.mesh.part_names if known else ()
    return {part: in_bytes(one.colour) for part, one in zip(names, coloured(estimate.ref, names, known), strict=True)}


def as_answer(result: Result, picture: str | None, judged: Judged | None = None) -> dict[str, Any]:
    """A result as `models.EstimateResult`; it is ranked when its candidates are built."""
    plain, estimate = to_dict(result), result.estimate
    nothing = [None] * len(estimate.candidates)
    pictures = (judged and judged.thumbnails) or nothing
    colours = judged.colours if judged else nothing
    candidates = [
        candidate | {"thumbnail": picture, "colours": coloured or {}}
        for candidate, picture, coloured in zip(plain["candidates"], pictures, colours, strict=True)
    ]
    return plain | {
        "generators": result.probabilities or {estimate.generator: 1.0},
        "ranked": bool(estimate.candidates) and all(c.mesh is not None for c in estimate.candidates),
        "note": note(result),
        "picture": picture,
        "candidates": candidates,
    }


def note(result: Result) -> str:
    """A sentence or two about the result."""
    name, share = next(iter(result.probabilities.items()), ("", 1.0))
    which = f"Recognised as {name} ({100 * share:.0f} % sure). " if len(result.probabilities) > 1 else ""
    return which + (f"Careful: {result.doubt}" if result.doubt else "")


def _seen_from_one_side(estimate: Estimate, meshes: Sequence[Mesh | BuildError], studio: Studio) -> Estimate:
    """Candidates from a sentence, which have no camera of their own."""
    view = replace(studio.generator(estimate.generator).views.middle, azimuth_deg=TEXT_VIEW.azimuth_deg)
    built = [mesh if isinstance(mesh, Mesh) else None for mesh in meshes]
    seen = [replace(c, view=view, mesh=mesh) for c, mesh in zip(estimate.candidates, built, strict=True)]
    return replace(estimate, candidates=seen)


def _renderer() -> Renderer:
    """The renderer of this thread, since an OpenGL context belongs to the thread that made it."""
    if not hasattr(_own, "renderer"):
        _own.renderer = Renderer(TILE)
    return _own.renderer
