"""The classifier of pictures: which generator's objects a picture shows, from the summary of a shipped encoder.

It takes milliseconds, where estimates by all generators take a minute. It belongs to the encoder that it was fitted on
and is used with no other.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from safetensors import safe_open
from safetensors.torch import save
from torch import Tensor

from dipcg.files import write_file
from dipcg.images import Cutout, Source, cut_out
from dipcg.model.zoo import SHIPPED
from dipcg.pipeline import Inverter

FILE = SHIPPED / "classifier.safetensors"
# The checkpoint whose encoder is used: it has learnt from the most pictures.
ENCODER = "chair"


@dataclass(frozen=True)
class Classifier:
    """The weights of a linear classifier, the names of its classes, and the fingerprint of its encoder."""

    names: tuple[str, ...]
    encoder: str
    weight: Float[Tensor, "k w"]
    bias: Float[Tensor, " k"]

    def classify(self, picture: Source | Cutout, inverter: Inverter) -> dict[str, float]:
        """The probability that a picture shows each class, the likeliest first; `inverter` has the encoder.

        Raises images.ImageError.
        """
        return self.classify_many([cut_out(picture)], inverter)[0]

    def classify_many(self, pictures: Sequence[Cutout], inverter: Inverter) -> list[dict[str, float]]:
        """As `classify`, for several pictures in one pass of the encoder."""
        with torch.inference_mode():
            features = inverter.features(*(picture.crop(inverter.image_size) for picture in pictures))
            return [self.probabilities(summary[None]) for summary in features.summary]

    def probabilities(self, summary: Float[Tensor, "1 w"]) -> dict[str, float]:
        """The probability of each class given an encoder's summary, the likeliest first."""
        shares = F.linear(summary, self.weight, self.bias).softmax(1)[0].tolist()
        return dict(sorted(zip(self.names, shares, strict=True), key=lambda pair: -pair[1]))

    def save(self, path: Path) -> None:
        """Write the weights as safetensors, with the names and the fingerprint as metadata."""
        about = {"names": json.dumps(self.names), "encoder": self.encoder}
        write_file(path, save({"weight": self.weight.contiguous(), "bias": self.bias.contiguous()}, about))


def load_classifier(inverter: Inverter, path: Path = FILE) -> Classifier | None:
    """The classifier that ships, if it was fitted on the encoder of this estimator."""
    classifier = read_classifier(path) if path.is_file() else None
    return classifier if classifier and classifier.encoder == fingerprint(inverter) else None


def read_classifier(path: Path) -> Classifier:
    """A classifier as `Classifier.save` wrote it."""
    with safe_open(path, "pt") as file:
        about, weight, bias = file.metadata(), file.get_tensor("weight"), file.get_tensor("bias")
    return Classifier(tuple(json.loads(about["names"])), about["encoder"], weight, bias)


def among(probabilities: Mapping[str, float], names: Collection[str]) -> dict[str, float]:
    """The probabilities of these names alone, scaled to a sum of 1."""
    chosen = {name: probability for name, probability in probabilities.items() if name in names}
    total = sum(chosen.values())
    return {name: probability / total for name, probability in chosen.items()}


def fingerprint(inverter: Inverter) -> str:
    """A hash of an encoder's weights as checkpoints store them, in half precision."""
    sha = hashlib.sha256()
    for value in inverter.model.encoder.state_dict().values():
        sha.update((value.half() if value.is_floating_point() else value).contiguous().numpy().tobytes())
    return sha.hexdigest()[:16]
