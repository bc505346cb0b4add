"""What tests of the app share: a server over the toy with a network that knows nothing but has many opinions."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import torch
from boxes import TINY, TRUTH, VIEW, untrained

from dipcg.app.server import build_page, launch
from dipcg.app.service import Studio
from dipcg.app.state import Found, Work
from dipcg.config import ModelConfig
from dipcg.inference.inverters import Inverters
from dipcg.model.checkpoint import save_checkpoint
from dipcg.pipeline import Inverter

OPEN = Work("box", (Found(TRUTH, VIEW),), 0, TRUTH)


class Quick(Studio):
    """A studio that shows half as many candidates, since ranking takes the time; its text estimator is untrained."""

    def __init__(self, names: list[str], workers: int) -> None:
        super().__init__(names, workers, candidates=4)
        self.text_inverters = TextInverters(self.names, reads="text")


class TextInverters(Inverters):
    """An untrained estimator from text for every generator."""

    def _load(self, ref: str) -> Inverter:
        return self._loaded.setdefault(ref, opinionated(replace(TINY, encoder="sentence")))


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
