"""What tests of the app share: a server over the toy with a network that knows nothing but has many opinions."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from boxes import TINY, TRUTH, VIEW, untrained

from dipcg.app.server import build_page, launch
from dipcg.app.service import Studio
from dipcg.app.state import Found, Work
from dipcg.config import ModelConfig
from dipcg.images import Source
from dipcg.model.checkpoint import save_checkpoint
from dipcg.pipeline import Estimate, Inverter

OPEN = Work("box", (Found(TRUTH, VIEW),), 0, TRUTH)


class Quick(Studio):
    """A studio that finds half as many candidates where nobody says how many, since ranking takes the time.

    Its estimator of words knows nothing either.
    """

    def _reader(self, name: str) -> Inverter:
        return self._readers.setdefault(name, opinionated(replace(TINY, encoder="sentence")))

    def estimate(self, picture: Source, name: str, *given: Any, **settings: Any) -> Estimate:
        return super().estimate(picture, name, *given, **({} if len(given) > 1 else {"candidates": 4}) | settings)


def opinionated(config: ModelConfig = TINY) -> Inverter:
    inverter = untrained("box", config)
    for weight in (inverter.model.denoiser.read, inverter.model.denoiser.read_options):  # type: ignore[union-attr]
        torch.nn.init.normal_(weight)
    return inverter


def box_checkpoint(folder: Path) -> str:
    inverter = opinionated()
    save_checkpoint(folder, inverter.model, inverter.generator, {})
    return str(folder)


@contextlib.contextmanager
def serving(studio: Studio, folder: Path) -> Iterator[str]:
    """The address of a server with the page of a studio."""
    page = build_page(studio, folder)
    try:
        yield launch(page, quiet=True, prevent_thread_lock=True)
    finally:
        page.close(verbose=False)
