"""An encoder over a frozen vision transformer of the package `transformers`, which is no part of a checkpoint."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dipcg.config import ModelConfig
from dipcg.encoders import Features

# The side in pixels of the pictures that both DINOv2 and CLIP get here.
IMAGE_SIZE = 224


class PretrainedEncoder(nn.Module):
    """The patch tokens of a frozen network, and a trained linear summary of its class token.

    The network is no submodule, so that it is neither trained nor averaged nor saved, and stays in evaluation mode.
    `mean` and `deviation` normalise the three colour channels, which are in [0, 1].
    """

    image_size = IMAGE_SIZE
    mean: Tensor
    deviation: Tensor

    def __init__(self, network: Any, config: ModelConfig, mean: list[float], deviation: list[float]) -> None:
        super().__init__()
        # A tuple hides the network from `nn.Module`.
        self._frozen = (network,)
        self.channels = int(network.config.hidden_size)
        self.pool = nn.Linear(self.channels, config.summary) if config.summary else None
        self.register_buffer("mean", torch.tensor(mean)[:, None, None], persistent=False)
        self.register_buffer("deviation", torch.tensor(deviation)[:, None, None], persistent=False)

    def forward(self, images: Float[Tensor, "b 3 s s"]) -> Features:
        with torch.no_grad():
            hidden = self._frozen[0]((images - self.mean) / self.deviation).last_hidden_state
        class_token, tokens = hidden[:, 0], hidden[:, 1:]
        return Features(tokens, class_token[:, :0] if self.pool is None else self.pool(class_token))

    def _apply(self, fn: Any, recurse: bool = True) -> Any:
        # `nn.Module` moves its submodules to another device, and the frozen network is none.
        self._frozen[0]._apply(fn)
        return super()._apply(fn, recurse)


@lru_cache(maxsize=4)
def pretrained(network: str, name: str) -> Any:
    """Load the weights `name`, a hub name or a folder, into the class `network` of `transformers`, and freeze it.

    Raises RuntimeError when the package or the weights are missing, with the commands that install or download them.
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
