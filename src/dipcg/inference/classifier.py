"""Telling kinds of objects apart at first sight: a linear classifier on the summary that a shipped encoder makes.

One glance takes milliseconds, where letting every estimator try takes a minute. It belongs to the very encoder that it
was fitted on, and says nothing with any other.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from dipcg.images import Source, prepare
from dipcg.model.zoo import SHIPPED
from dipcg.pipeline import Inverter

FILE = SHIPPED / "kinds.safetensors"
ENCODER = "chair"  # the checkpoint whose encoder is used: it has seen the most pictures


@dataclass(frozen=True)
class Kinds:
    """Weights of the classifier, the names it tells apart, and the fingerprint of its encoder."""

    names: tuple[str, ...]
    encoder: str
    weight: Float[Tensor, "k w"]
    bias: Float[Tensor, " k"]

    def chances(self, inverter: Inverter, image: Source) -> list[tuple[str, float]]:
        """The names with the chance that the picture shows each, the likeliest first."""
        with torch.inference_mode():
            return self.shares(inverter.features(prepare(image, inverter.image_size)[0]).summary)

    def shares(self, summary: Float[Tensor, "1 w"]) -> list[tuple[str, float]]:
        """The names with their chances given what an encoder made of one thing, the likeliest first."""
        shares = F.linear(summary, self.weight, self.bias).softmax(1)[0].tolist()
        return sorted(zip(self.names, shares, strict=True), key=lambda pair: -pair[1])

    def save(self, path: Path) -> None:
        """Write a file of weights with the rest as its metadata."""
        about = {"names": json.dumps(self.names), "encoder": self.encoder}
        save_file({"weight": self.weight.contiguous(), "bias": self.bias.contiguous()}, path, about)


def load_kinds(inverter: Inverter, path: Path = FILE) -> Kinds | None:
    """The classifier that ships, if it was fitted on this estimator's encoder."""
    found = read_kinds(path) if path.is_file() else None
    return found if found and found.encoder == fingerprint(inverter) else None


def read_kinds(path: Path) -> Kinds:
    """A classifier as `Kinds.save` wrote it."""
    with safe_open(path, "pt") as file:
        about, weight, bias = file.metadata(), file.get_tensor("weight"), file.get_tensor("bias")
    return Kinds(tuple(json.loads(about["names"])), about["encoder"], weight, bias)


def among(chances: Sequence[tuple[str, float]], names: Collection[str]) -> list[tuple[str, float]]:
    """The chances of these names alone, which sum to 1 again."""
    known = [(name, chance) for name, chance in chances if name in names]
    total = sum(chance for _, chance in known)
    return [(name, chance / total) for name, chance in known]


def fingerprint(inverter: Inverter) -> str:
    """A hash of an encoder's weights as checkpoints store them, in half precision."""
    found = hashlib.sha256()
    for value in inverter.model.encoder.state_dict().values():
        found.update((value.half() if value.is_floating_point() else value).contiguous().numpy().tobytes())
    return found.hexdigest()[:16]
