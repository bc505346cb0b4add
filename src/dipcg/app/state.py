"""What one visitor has on the table, as plain values, and what can be done to it; nothing here knows of a page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import UInt8

from dipcg.camera import View
from dipcg.pipeline import Estimate
from dipcg.space import ParameterSpace, Params, Value

MOST_UNDONE = 100  # edits that can be undone

Asked = UInt8[np.ndarray, "h w 4"] | str  # a picture, or words


@dataclass(frozen=True)
class Found:
    """One candidate as it is kept: the mesh is built again when it is opened."""

    params: Params
    view: View
    agreement: float | None = None


@dataclass(frozen=True)
class Work:
    """One visitor's work: what the picture may show, the asset that is open, what is held, and what came before."""

    generator: str = ""
    candidates: tuple[Found, ...] = ()
    chosen: int = -1
    params: Params = field(default_factory=dict)
    spread: Mapping[str, float] = field(default_factory=dict)
    chances: Mapping[str, Mapping[Value, float]] = field(default_factory=dict)
    held: frozenset[str] = frozenset()
    before: tuple[Params, ...] = ()
    moving: str = ""  # the parameter whose slider is being dragged: one drag is one step to undo
    opened: int = 0  # counts the assets opened, so that the viewer knows when to aim its camera anew
    asked: Asked | None = None  # to estimate from again


def opened(work: Work, index: int) -> Work:
    """Open a candidate; raises ValueError when there is none of this number."""
    if not 0 <= index < len(work.candidates):
        raise ValueError(f"There are {len(work.candidates)} candidates, and none has the number {index + 1}.")
    params = work.candidates[index].params
    return replace(work, chosen=index, params=params, before=(), moving="", opened=work.opened + 1)


def estimated(estimate: Estimate, asked: Asked, held: frozenset[str] = frozenset()) -> Work:
    """An estimate for a picture or for words, its best candidate open."""
    candidates = tuple(Found(c.params, c.view, c.agreement) for c in estimate.candidates)
    fresh = Work(estimate.generator, candidates, 0, {}, estimate.spread, estimate.probabilities, held, asked=asked)
    return opened(fresh, 0)


def replaced(work: Work, fresh: Work) -> Work:
    """Another asset laid on the table, as newly opened."""
    return replace(fresh, opened=work.opened + 1)


def drawn_at_random(work: Work, generator: str, space: ParameterSpace, rng: np.random.Generator) -> Work:
    """Random parameters, those that are held kept: as one step to undo when an asset of the generator is open."""
    params = space.sample(rng)
    if work.generator != generator or not work.params:
        return Work(generator, params=params, opened=work.opened + 1)
    kept = {name: work.params[name] for name in work.held}
    return replace(work, params=space.replace(params, kept), before=_remembered(work), moving="")


def edited(work: Work, space: ParameterSpace, name: str, value: Any, final: bool = True) -> Work:
    """One parameter changed; raises ValueError with a sentence."""
    params = space.replace(work.params, {name: value})
    before = work.before if work.moving == name else _remembered(work)
    return replace(work, params=params, before=before, moving="" if final else name)


def undone(work: Work) -> Work:
    """The last change taken back; nothing happens when there is none."""
    if not work.before:
        return work
    return replace(work, params=work.before[-1], before=work.before[:-1], moving="")


def reset(work: Work) -> Work:
    """The open candidate as it was found, or the random asset as it was drawn."""
    first = work.candidates[work.chosen].params if work.chosen >= 0 else (*work.before, work.params)[0]
    return replace(work, params=first, before=_remembered(work), moving="")


def held(work: Work, space: ParameterSpace, name: str) -> Work:
    """Hold a parameter, or let it go; raises ValueError for an unknown name."""
    space.find(name)
    return replace(work, held=work.held ^ {name})


def to_keep(work: Work) -> Params:
    """The held parameters with their values, as `Inverter.estimate` takes them."""
    return {name: work.params[name] for name in sorted(work.held)}


def command(generator: str, space: ParameterSpace, params: Params, file: str) -> str:
    """The command line that makes the same asset again, to the last digit."""
    settings = [f"{name}={params[name]!s}" for name in space.names if space.is_active(name, params)]
    return shlex.join(["dipcg", "sample", generator, "--set", *settings, "-o", file])


def _remembered(work: Work) -> tuple[Params, ...]:
    return (*work.before, work.params)[-MOST_UNDONE:] if work.params else work.before
