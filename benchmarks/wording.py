"""How far words are understood that training never saw: `python -m benchmarks.wording NAME DATA [MINUTES]`.

An estimator of words is trained with a quarter of its phrases left out, and asked in captions of the phrases that it
knows and in captions of the others. What lies between the two is what more phrases, not more minutes, would gain, and
recipes can be tried on it without a look at the held-out sentences of `benchmarks.words`.
"""

import sys
import tempfile
from functools import cache
from typing import Any
from zlib import crc32

import numpy as np
import torch

from benchmarks.timing import header, machine, row
from dipcg.config import ModelConfig, TrainConfig
from dipcg.encoders.sentence import embed
from dipcg.pipeline import Inverter
from dipcg.space import Choice, Parameter
from dipcg.training import captions
from dipcg.training.train import train

MODEL = ModelConfig(encoder="sentence", width=128, heads=4, depth=2, summary=256)
CAPTIONS = 400
# The entries of a file of words that are no phrases about a parameter.
KEPT = ("nouns", "only")

every_phrase = captions._load_phrases


def main(name: str, data: str, minutes: str = "3") -> None:
    config = TrainConfig(minutes=float(minutes), batch=128, repeats=8, denoiser_share=0.4, draws=2)
    print(f"{machine()}; {minutes} minutes of training\n")
    with tempfile.TemporaryDirectory() as folder:
        captions._load_phrases = phrases_known
        train(data, f"{folder}/{name}", config, MODEL)
        with Inverter.load(f"{folder}/{name}") as inverter:
            header("captions of", "choices said, true", "highs and lows said, true")
            row("phrases it knows", *true(inverter))
            captions._load_phrases = phrases_left_out
            row("phrases left out of training", *true(inverter))


@cache
def phrases_known(generator: str) -> dict[str, Any]:
    return _some(generator, left_out=False)


@cache
def phrases_left_out(generator: str) -> dict[str, Any]:
    return _some(generator, left_out=True)


def _some(generator: str, left_out: bool) -> dict[str, Any]:
    """The file of words with those phrases alone; an option without one is not spoken of."""
    found = dict(every_phrase(generator))
    for name in found.keys() - set(KEPT):
        chosen = {o: [p for p in said if (crc32(p.encode()) % 4 == 0) == left_out] for o, said in found[name].items()}
        found[name] = {option: said for option, said in chosen.items() if said}
    return found


@torch.inference_mode()
def true(inverter: Inverter) -> list[str]:
    """Of what captions say, how much is so in the network's first guess, as a choice and as a half of a range."""
    generator, rng = inverter.generator, np.random.default_rng(5)
    many = [generator.space.sample(rng) for _ in range(CAPTIONS)]
    told = [captions.labelled_caption(generator, params, rng) for params in many]
    features = inverter.model.encoder(embed([sentence for sentence, _ in told]))
    guessed = inverter.model.outputs.modes(inverter.model.first_guess(features)).double().numpy()
    right: dict[bool, list[bool]] = {True: [], False: []}
    for params, (_, names), x in zip(many, told, guessed, strict=True):
        found = generator.space.decode(x[: len(generator.space)])
        for name in names:
            parameter = generator.space[name]
            so = _is_so(parameter, captions.value_label(parameter, params[name]), found[name])
            right[isinstance(parameter, Choice)].append(so and generator.space.is_active(name, found))
    return [f"{np.mean(right[kind]):.0%} of {len(right[kind])}" if right[kind] else "" for kind in (True, False)]


def _is_so(parameter: Parameter, said: str | None, value: Any) -> bool:
    if isinstance(parameter, Choice):
        return str(value) == said
    return (value > (parameter.low + parameter.high) / 2) == (said == "high")


if __name__ == "__main__":
    main(*sys.argv[1:])
