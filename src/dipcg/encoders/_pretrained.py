"""What encoders over a vision transformer of `transformers` share: frozen, and no part of a checkpoint."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dipcg.config import ModelConfig
from dipcg.encoders import Features

IMAGE_SIZE = 224


class PretrainedEncoder(nn.Module):
    """Patch tokens of a frozen network, and a trained linear summary of its class token.

    The network is no submodule: it is neither trained nor averaged nor saved, and stays in evaluation mode.
    """

    image_size = IMAGE_SIZE
    mean: Tensor
    spread: Tensor

    def __init__(self, network: Any, config: ModelConfig, mean: list[float], spread: list[float]) -> None:
        super().__init__()
        self._held = (network,)
        self.channels = int(network.config.hidden_size)
        self.pool = nn.Linear(self.channels, config.summary) if config.summary else None
        self.register_buffer("mean", torch.tensor(mean)[:, None, None], persistent=False)
        self.register_buffer("spread", torch.tensor(spread)[:, None, None], persistent=False)

    def forward(self, images: Float[Tensor, "b 3 s s"]) -> Features:
        with torch.no_grad():
            found = self._held[0]((images - self.mean) / self.spread).last_hidden_state
        first, tokens = found[:, 0], found[:, 1:]
        return Features(tokens, first[:, :0] if self.pool is None else self.pool(first))

    def _apply(self, fn: Any, recurse: bool = True) -> Any:
        self._held[0]._apply(fn)  # follows to another device
        return super()._apply(fn, recurse)


@lru_cache(maxsize=4)
def pretrained(network: str, name: str) -> Any:
    """A frozen network of `transformers` (a class name) from a hub name or a folder.

    Raises RuntimeError with the commands that get the weights when they are not there.
    """
    try:
        import transformers
    except ImportError:
        raise RuntimeError("This encoder needs transformers: run `pip install 'dipcg[foundation]'`.") from None
    try:
        return getattr(transformers, network).from_pretrained(name).eval().requires_grad_(False)
    except (OSError, ValueError) as error:
        folder = name.rpartition("/")[2]
        raise RuntimeError(
            f"The weights {name!r} could not be loaded ({str(error).splitlines()[0]}). "
            f"On a machine with internet run `hf download {name} --local-dir {folder}`, copy the folder here, "
            f"and add `--encoder-weights ./{folder}`."
        ) from None
