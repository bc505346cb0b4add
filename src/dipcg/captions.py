"""Sentences that describe parameters: a small grammar from the names, options and quantiles of a declared space.

`words/NAME.toml` gives a generator phrases of its own: for options of a choice, and for the low and the high end of a
real parameter. A generator without such a file is described with the names of its parameters.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dipcg.generators import Generator
from dipcg.space import Choice, Parameter, Params, Real

FOLDER = Path(__file__).parent / "words"
LOW, HIGH = 0.25, 0.75  # quantiles from which a real parameter is worth a word
AFTER = ("with", "without", "on", "that", "no ", "close", "leaning")  # how phrases begin that follow the noun
MOST = 7  # things said in one sentence

Phrases = Mapping[str, Mapping[str, Sequence[str]]]


def load_words(generator: Generator) -> tuple[list[str], Phrases]:
    """The nouns for a generator's asset, and the phrases for each parameter."""
    path = FOLDER / f"{generator.name}.toml"
    given = tomllib.loads(path.read_text()) if path.is_file() else {}
    nouns = given.pop("nouns", [generator.name])
    return nouns, given or {p.name: _plain_words(p) for p in generator.space}


def says(parameter: Parameter, value: object) -> str | None:
    """The word of `words/NAME.toml` that a value stands under: its option, low, high, or None for the middle."""
    if isinstance(parameter, Choice):
        return str(value)
    share = (float(value) - parameter.low) / (parameter.high - parameter.low)  # type: ignore[arg-type]
    return "low" if share <= LOW else "high" if share >= HIGH else None


def caption(generator: Generator, params: Params, rng: np.random.Generator) -> str:
    """One of many sentences about an asset: a random few of the things that are true of it."""
    nouns, phrases = load_words(generator)
    space = generator.space
    active = [p for p, on in zip(space, space.active(params), strict=True) if on]
    true = [(p.name, said) for p in active if (said := says(p, params[p.name])) in phrases.get(p.name, ())]
    chosen = rng.permutation(len(true))[: rng.integers(1, MOST + 1)]
    parts = [str(rng.choice(phrases[true[i][0]][true[i][1]])) for i in chosen]
    return _sentence(str(rng.choice(nouns)), parts, rng)


def _sentence(noun: str, parts: list[str], rng: np.random.Generator) -> str:
    after = [part for part in parts if part.startswith(AFTER)]
    before = [part for part in parts if part not in after]
    if rng.random() < 0.3:  # as people type into a search box
        return ", ".join(rng.permutation([noun, *parts]).tolist())
    start = " ".join([str(rng.choice(["a", "one", ""])), ", ".join(before), noun])
    joined = str(rng.choice([" and ", ", ", " "])).join(after)
    return " ".join(f"{start} {joined}".split())


def _plain_words(parameter: Parameter) -> dict[str, list[str]]:
    """Phrases from the parameter's own name."""
    name = parameter.name.replace("_", " ")
    if isinstance(parameter, Real):
        return {"low": [f"with low {name}", f"with little {name}"], "high": [f"with high {name}", f"with much {name}"]}
    bare = name.removeprefix("has ").removeprefix("is ").removesuffix(" type")
    if set(parameter.options) == {True, False}:
        return {"True": [f"with {bare}"], "False": [f"without {bare}", f"with no {bare}"]}
    return {str(option): [f"with {bare} {option}", f"with {option} {bare}"] for option in parameter.options}
