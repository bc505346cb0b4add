"""What tests of the app share: a server over the toy with a network that knows nothing but has many opinions."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from boxes import TRUTH, VIEW, untrained

from dipcg.app import build_page, launch
from dipcg.app_studio import Studio
from dipcg.app_work import Found, Work
from dipcg.checkpoint import save_checkpoint
from dipcg.images import Source
from dipcg.pipeline import Estimate

OPEN = Work("box", (Found(TRUTH, VIEW),), 0, TRUTH)


class Quick(Studio):
    """A studio that finds half as many candidates where nobody says how many, since ranking takes the time."""

    def estimate(self, picture: Source, name: str, *given: Any, **settings: Any) -> Estimate:
        return super().estimate(picture, name, *given, **({} if len(given) > 1 else {"candidates": 4}) | settings)


def box_checkpoint(folder: Path) -> str:
    inverter = untrained("box")
    for weight in (inverter.model.denoiser.read, inverter.model.denoiser.read_options):
        torch.nn.init.normal_(weight)
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
