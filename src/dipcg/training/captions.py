"""Sentences that describe parameters: a small grammar from the names, options and quantiles of a declared space.

`words/NAME.toml` gives a generator phrases of its own: for options of a choice, and for the low and the high end of a
real parameter. A generator without such a file is described with the names of its parameters. `words/_thesaurus.toml`
has words that may stand for one another in any phrase, `words/_chatter.toml` what people say besides, which tells
nothing of the shape and is to be heard as such.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from dipcg.generators import Generator
from dipcg.space import Choice, Parameter, Params, Real

FOLDER = Path(__file__).parent / "words"
LOW, HIGH = 0.25, 0.75  # quantiles from which a real parameter is worth a word
AFTER = {  # words that phrases begin with which follow the noun
    "with", "without", "on", "that", "no", "close", "leaning", "whose", "having", "standing", "where", "like", "for",
    "of", "about", "under", "over", "less", "more", "in", "not", "minus", "made", "as", "featuring", "which",
    "showing", "sporting", "it", "has", "and", "lacking", "free",
}  # fmt: skip
MOST = 7  # things said in one sentence
REWORDED = 0.4  # how often a word of a phrase is put in others, where the thesaurus has some
WORDINGS = 8  # of each phrase
CHATTER = 0.4  # how often something is said before, after, and in between

Phrases = Mapping[str, Mapping[str, Sequence[str]]]


def load_words(generator: Generator) -> tuple[list[str], Phrases]:
    """The nouns for a generator's asset, and the phrases for each parameter."""
    given = dict(_load_phrases(generator.name))
    nouns = given.pop("nouns", [generator.name])
    given.pop("only", None)
    return nouns, given or {p.name: _plain_words(p) for p in generator.space}


@cache
def _load_phrases(generator: str) -> dict[str, Any]:
    path = FOLDER / f"{generator}.toml"
    return tomllib.loads(path.read_text()) if path.is_file() else {}


def says(parameter: Parameter, value: object) -> str | None:
    """The word of `words/NAME.toml` that a value stands under: its option, low, high, or None for the middle."""
    if isinstance(parameter, Choice):
        return str(value)
    share = (float(value) - parameter.low) / (parameter.high - parameter.low)  # type: ignore[arg-type]
    return "low" if share <= LOW else "high" if share >= HIGH else None


def caption(generator: Generator, params: Params, rng: np.random.Generator, nouns: Sequence[str] | None = None) -> str:
    """One of many sentences about an asset: a random few of the things that are true of it.

    It is called by one of the generator's nouns, unless others are given.
    """
    return tell(generator, params, rng, nouns)[0]


def tell(
    generator: Generator, params: Params, rng: np.random.Generator, nouns: Sequence[str] | None = None
) -> tuple[str, list[str]]:
    """A caption, and the names of the parameters that it says something about."""
    noun, parts, names = _chosen(generator, params, rng, nouns)
    return _with_chatter(noun, parts, rng), names


def pieces(generator: Generator, params: Params, rng: np.random.Generator) -> tuple[list[str], list[str]]:
    """What a caption is made of, noun, phrases and chatter in any order, and the names of the parameters told."""
    noun, parts, names = _chosen(generator, params, rng)
    return _shuffled([noun, *parts, *filter(None, _chatter(rng))], rng), names


def _chosen(
    generator: Generator, params: Params, rng: np.random.Generator, nouns: Sequence[str] | None = None
) -> tuple[str, list[str], list[str]]:
    """A noun, a random few of the phrases that are true, and the parameters that they are about."""
    own, phrases = load_words(generator)
    space = generator.space
    active = [p for p, on in zip(space, space.active(params), strict=True) if on and _may_be_told(generator, p, params)]
    true = [(p.name, said) for p in active if (said := says(p, params[p.name])) in phrases.get(p.name, ())]
    chosen = [true[i] for i in rng.permutation(len(true))[: rng.integers(1, MOST + 1)]]
    parts = [reworded(generator, _one(phrases[name][said], rng), rng) for name, said in chosen]
    return _one(nouns or own, rng), parts, [name for name, _ in chosen]


def reworded(generator: Generator, phrase: str, rng: np.random.Generator) -> str:
    """The phrase, often with a few of its words put in others."""
    return _one(_wordings(generator.name, phrase), rng)


@cache
def _wordings(generator: str, phrase: str) -> list[str]:
    """Some wordings of a phrase, always the same ones, since each has to be read once; none stands for another."""
    rng = np.random.default_rng(crc32(phrase.encode()))
    said = [_in_other_words(phrase, rng) for _ in range(WORDINGS)]
    return [phrase if words in _known(generator) else words for words in said]


def _in_other_words(phrase: str, rng: np.random.Generator) -> str:
    anywhere, first = _load_thesaurus()
    words = re.split(r"(\W+)", phrase)
    for i, word in enumerate(words):
        others = first.get(word) if i == 0 and word in first else anywhere.get(word)
        if others and rng.random() < REWORDED:
            words[i] = _one(others, rng)
    return re.sub(r"\ba(?= [aeiou])", "an", re.sub(r"\ban(?= [^aeiou\W])", "a", "".join(words)))


@cache
def _known(generator: str) -> frozenset[str]:
    """Every phrase of a generator's file."""
    tables = [table for name, table in _load_phrases(generator).items() if name not in ("nouns", "only")]
    return frozenset(said for by_value in tables for phrases in by_value.values() for said in phrases)


def _may_be_told(generator: Generator, parameter: Parameter, params: Params) -> bool:
    """Whether the conditions hold that the words file's table `only` sets for phrases about a parameter.

    They name options of a choice, and of a real parameter low, middle and high.
    """
    conditions = _load_phrases(generator.name).get("only", {}).get(parameter.name, {})
    space = generator.space
    return all((says(space[name], params[name]) or "middle") in options for name, options in conditions.items())


def _with_chatter(noun: str, parts: list[str], rng: np.random.Generator) -> str:
    opening, ending, adjective = _chatter(rng)
    said = _sentence(noun, [adjective, *parts] if adjective else parts, rng)
    return " ".join(f"{opening} {said} {ending}".split())


def _chatter(rng: np.random.Generator) -> tuple[str, str, str]:
    """An opening, an ending and an adjective, each of them mostly empty."""
    opening, ending, adjective = (
        _one(chatter, rng) if chatter and rng.random() < CHATTER else "" for chatter in _load_chatter()
    )
    return opening, ending, adjective


def _sentence(noun: str, parts: list[str], rng: np.random.Generator) -> str:
    after = [part for part in parts if part.split()[0] in AFTER]
    before = [part for part in parts if part not in after]
    if rng.random() < 0.3:  # as people type into a search box
        return ", ".join(_shuffled([noun, *parts], rng))
    start = " ".join([_one(["a", "one", ""], rng), ", ".join(before), noun])
    joined = _one([" and ", ", ", " "], rng).join(after)
    return " ".join(f"{start} {joined}".split())


def _one(options: Sequence[str], rng: np.random.Generator) -> str:
    return options[int(rng.integers(len(options)))]  # `choice` would make an array of them each time


def _shuffled(words: list[str], rng: np.random.Generator) -> list[str]:
    return [words[i] for i in rng.permutation(len(words))]


@cache
def _load_thesaurus() -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    """What may stand for a word anywhere, and what at the beginning of a phrase."""
    found = tomllib.loads((FOLDER / "_thesaurus.toml").read_text())
    return found["adjectives"] | found["quantities"] | found["things"], found["joints"]


@cache
def _load_chatter() -> tuple[list[str], list[str], list[str]]:
    found = tomllib.loads((FOLDER / "_chatter.toml").read_text())
    return found["openings"], found["endings"], found["adjectives"]


def _plain_words(parameter: Parameter) -> dict[str, list[str]]:
    """Phrases from the parameter's own name."""
    name = parameter.name.replace("_", " ")
    if isinstance(parameter, Real):
        return {"low": [f"with low {name}", f"with little {name}"], "high": [f"with high {name}", f"with much {name}"]}
    bare = name.removeprefix("has ").removeprefix("is ").removesuffix(" type")
    if set(parameter.options) == {True, False}:
        return {"True": [f"with {bare}"], "False": [f"without {bare}", f"with no {bare}"]}
    return {str(option): [f"with {bare} {option}", f"with {option} {bare}"] for option in parameter.options}
