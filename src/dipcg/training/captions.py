"""Captions: sentences that describe parameters, written by a small grammar from the declaration of a parameter space.

`words/NAME.toml` has the phrases of a generator: for the options of a choice, and for low and high values of a real
parameter. The phrases of a generator without such a file are made from the names of its parameters.
`words/_thesaurus.toml` has synonyms that may replace words in any phrase. `words/_chatter.toml` has filler, which says
nothing about the shape, so that an estimator learns to ignore it.
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

# The folder of the phrase files.
FOLDER = Path(__file__).parent / "words"
# The quantiles of a real parameter up to which a value is low, and from which it is high. Others are not described.
LOW, HIGH = 0.25, 0.75
# A phrase that begins with one of these words follows the noun.
AFTER_NOUN = {
    "with", "without", "on", "that", "no", "close", "leaning", "whose", "having", "standing", "where", "like", "for",
    "of", "about", "under", "over", "less", "more", "in", "not", "minus", "made", "as", "featuring", "which",
    "showing", "sporting", "it", "has", "and", "lacking", "free",
}  # fmt: skip
# The highest number of parameters that one sentence describes.
MAX_PHRASES = 7
# The probability that a word of a phrase is replaced by a synonym, where the thesaurus has one.
SYNONYM_PROBABILITY = 0.4
# The number of paraphrases of each phrase.
PARAPHRASES = 8
# The probability of each part of the filler: an opening, an ending and an adjective.
FILLER_PROBABILITY = 0.4
# The probability of a list of phrases in place of a sentence, as people type into a search box.
LIST_PROBABILITY = 0.3

# The phrases of a generator, by parameter and by the label of its value (`value_label`).
Phrases = Mapping[str, Mapping[str, Sequence[str]]]


def load_words(generator: Generator) -> tuple[list[str], Phrases]:
    """The nouns for an asset of a generator, and its phrases."""
    phrases = dict(_load_phrases(generator.name))
    nouns = phrases.pop("nouns", [generator.name])
    phrases.pop("only", None)
    return nouns, phrases or {p.name: _default_phrases(p) for p in generator.space}


@cache
def _load_phrases(generator: str) -> dict[str, Any]:
    path = FOLDER / f"{generator}.toml"
    return tomllib.loads(path.read_text()) if path.is_file() else {}


def value_label(parameter: Parameter, value: object) -> str | None:
    """The key of a value in `words/NAME.toml`: the option of a choice; "low", "high" or None of a real parameter."""
    if isinstance(parameter, Choice):
        return str(value)
    share = (float(value) - parameter.low) / (parameter.high - parameter.low)  # type: ignore[arg-type]
    return "low" if share <= LOW else "high" if share >= HIGH else None


def caption(generator: Generator, params: Params, rng: np.random.Generator, nouns: Sequence[str] | None = None) -> str:
    """A random sentence about some of the parameters of an asset.

    Its noun is one of `nouns`, or one of the generator's nouns.
    """
    return labelled_caption(generator, params, rng, nouns)[0]


def labelled_caption(
    generator: Generator, params: Params, rng: np.random.Generator, nouns: Sequence[str] | None = None
) -> tuple[str, list[str]]:
    """A caption, and the names of the parameters that it describes."""
    noun, phrases, names = _sample_phrases(generator, params, rng, nouns)
    return _with_filler(noun, phrases, rng), names


def caption_phrases(generator: Generator, params: Params, rng: np.random.Generator) -> tuple[list[str], list[str]]:
    """The noun, the phrases and the filler of a caption in random order, and the names of the described parameters."""
    noun, phrases, names = _sample_phrases(generator, params, rng)
    return _shuffled([noun, *phrases, *filter(None, _filler(rng))], rng), names


def _sample_phrases(
    generator: Generator, params: Params, rng: np.random.Generator, nouns: Sequence[str] | None = None
) -> tuple[str, list[str], list[str]]:
    """A noun, some phrases that are true of the parameters, and the names of the parameters that they describe."""
    own_nouns, phrases = load_words(generator)
    space = generator.space
    active = [p for p, on in zip(space, space.active(params), strict=True) if on and _is_allowed(generator, p, params)]
    labels = [(p.name, label) for p in active if (label := value_label(p, params[p.name])) in phrases.get(p.name, ())]
    chosen = [labels[i] for i in rng.permutation(len(labels))[: rng.integers(1, MAX_PHRASES + 1)]]
    texts = [paraphrase(generator, _pick(phrases[name][label], rng), rng) for name, label in chosen]
    return _pick(nouns or own_nouns, rng), texts, [name for name, _ in chosen]


def paraphrase(generator: Generator, phrase: str, rng: np.random.Generator) -> str:
    """A random paraphrase of a phrase, in which synonyms replace some words."""
    return _pick(_paraphrases(generator.name, phrase), rng)


@cache
def _paraphrases(generator: str, phrase: str) -> list[str]:
    """The paraphrases of a phrase, without any that is another phrase of the generator.

    They depend on the phrase alone, because each has to be encoded once.
    """
    rng = np.random.default_rng(crc32(phrase.encode()))
    candidates = [_with_synonyms(phrase, rng) for _ in range(PARAPHRASES)]
    return [phrase if text in _all_phrases(generator) else text for text in candidates]


def _with_synonyms(phrase: str, rng: np.random.Generator) -> str:
    anywhere, first = _load_thesaurus()
    words = re.split(r"(\W+)", phrase)
    for i, word in enumerate(words):
        synonyms = first.get(word) if i == 0 and word in first else anywhere.get(word)
        if synonyms and rng.random() < SYNONYM_PROBABILITY:
            words[i] = _pick(synonyms, rng)
    # The article has to fit the new word.
    return re.sub(r"\ba(?= [aeiou])", "an", re.sub(r"\ban(?= [^aeiou\W])", "a", "".join(words)))


@cache
def _all_phrases(generator: str) -> frozenset[str]:
    """All phrases in the file of a generator."""
    tables = [table for name, table in _load_phrases(generator).items() if name not in ("nouns", "only")]
    return frozenset(phrase for by_label in tables for phrases in by_label.values() for phrase in phrases)


def _is_allowed(generator: Generator, parameter: Parameter, params: Params) -> bool:
    """Whether the conditions hold that the table `only` of the generator's file sets for phrases of a parameter.

    A condition lists options of a choice, or "low", "middle" and "high" of a real parameter.
    """
    conditions = _load_phrases(generator.name).get("only", {}).get(parameter.name, {})
    space = generator.space
    return all((value_label(space[name], params[name]) or "middle") in options for name, options in conditions.items())


def _with_filler(noun: str, phrases: list[str], rng: np.random.Generator) -> str:
    opening, ending, adjective = _filler(rng)
    sentence = _sentence(noun, [adjective, *phrases] if adjective else phrases, rng)
    return " ".join(f"{opening} {sentence} {ending}".split())


def _filler(rng: np.random.Generator) -> tuple[str, str, str]:
    """An opening, an ending and an adjective, each of which is often empty."""
    opening, ending, adjective = (
        _pick(filler, rng) if filler and rng.random() < FILLER_PROBABILITY else "" for filler in _load_filler()
    )
    return opening, ending, adjective


def _sentence(noun: str, phrases: list[str], rng: np.random.Generator) -> str:
    after = [phrase for phrase in phrases if phrase.split()[0] in AFTER_NOUN]
    before = [phrase for phrase in phrases if phrase not in after]
    if rng.random() < LIST_PROBABILITY:
        return ", ".join(_shuffled([noun, *phrases], rng))
    start = " ".join([_pick(["a", "one", ""], rng), ", ".join(before), noun])
    joined = _pick([" and ", ", ", " "], rng).join(after)
    return " ".join(f"{start} {joined}".split())


def _pick(options: Sequence[str], rng: np.random.Generator) -> str:
    # `rng.choice` would make an array of the options in each call.
    return options[int(rng.integers(len(options)))]


def _shuffled(words: list[str], rng: np.random.Generator) -> list[str]:
    return [words[i] for i in rng.permutation(len(words))]


@cache
def _load_thesaurus() -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    """The synonyms of words anywhere in a phrase, and those of words at its beginning."""
    tables = tomllib.loads((FOLDER / "_thesaurus.toml").read_text())
    return tables["adjectives"] | tables["quantities"] | tables["things"], tables["joints"]


@cache
def _load_filler() -> tuple[list[str], list[str], list[str]]:
    tables = tomllib.loads((FOLDER / "_chatter.toml").read_text())
    return tables["openings"], tables["endings"], tables["adjectives"]


def _default_phrases(parameter: Parameter) -> dict[str, list[str]]:
    """Phrases from the name of a parameter and its options."""
    name = parameter.name.replace("_", " ")
    if isinstance(parameter, Real):
        return {"low": [f"with low {name}", f"with little {name}"], "high": [f"with high {name}", f"with much {name}"]}
    bare = name.removeprefix("has ").removeprefix("is ").removesuffix(" type")
    if set(parameter.options) == {True, False}:
        return {"True": [f"with {bare}"], "False": [f"without {bare}", f"with no {bare}"]}
    return {str(option): [f"with {bare} {option}", f"with {option} {bare}"] for option in parameter.options}
