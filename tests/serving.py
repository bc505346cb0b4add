"""What tests of the app share: a server over the toy with a network that knows nothing but has many opinions."""

import contextlib
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import torch
import uvicorn
from boxes import TINY, untrained

from dipcg.app.server import make_app, settings
from dipcg.app.studio import Studio
from dipcg.config import ModelConfig
from dipcg.inference.inverters import Inverters
from dipcg.model.checkpoint import save_checkpoint
from dipcg.pipeline import Inverter


class Quick(Studio):
    """A studio whose text estimator is untrained."""

    def __init__(self, names: list[str], workers: int) -> None:
        super().__init__(names, workers)
        self.text_inverters = TextInverters(self.names, reads="text")

    def reads_text(self, name: str) -> bool:
        return True


class TextInverters(Inverters):
    """An untrained estimator from text for every generator."""

    def _load(self, ref: str) -> Inverter:
        return self._loaded.setdefault(ref, opinionated(replace(TINY, encoder="sentence")))


def opinionated(config: ModelConfig = TINY, generator: str = "box") -> Inverter:
    inverter = untrained(generator, config)
    for weight in (inverter.model.denoiser.read, inverter.model.denoiser.read_options):  # type: ignore[union-attr]
        torch.nn.init.normal_(weight)
    return inverter


def box_checkpoint(folder: Path, generator: str = "box") -> str:
    inverter = opinionated(generator=generator)
    save_checkpoint(folder, inverter.model, inverter.generator, {})
    return str(folder)


@contextlib.contextmanager
def serving(
    studio: Studio, folder: Path, hosts: tuple[str, ...] = (), learn: Path | None = None, blender: str = ""
) -> Iterator[str]:
    """The address of a server over a studio, in a thread of this process."""
    app = make_app(studio, folder, hosts, learn, blender)
    server = uvicorn.Server(uvicorn.Config(**settings(app, "127.0.0.1", 0)))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        time.sleep(0.01)
    try:
        yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join()
