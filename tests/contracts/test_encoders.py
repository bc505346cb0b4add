"""The contract of encoders, checked for each registered encoder."""

from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from dipcg import registry
from dipcg.config import ModelConfig
from dipcg.encoders import Features, build_encoder

CONFIG = {"width": 16, "depth": 1, "heads": 2, "summary": 24}
# Convolutions add in an order that depends on the batch size.
TOLERANCE = {"rtol": 1e-4, "atol": 1e-4}


# The encoder that is a file of a user's.
EXAMPLE = str(Path(__file__).parents[2] / "examples" / "efficientnet.py")


@pytest.fixture(scope="module", params=[*registry.names("encoders"), EXAMPLE])
def encoder(request, pretrained) -> nn.Module:
    torch.manual_seed(0)
    registry.allow_code(EXAMPLE)
    return build_encoder(
        ModelConfig(encoder=request.param, encoder_weights=pretrained.get(request.param, ""), **CONFIG)
    ).eval()


@pytest.fixture(scope="module")
def images(encoder) -> Tensor:
    """Three random pictures, or random tokens for an encoder of sentences."""
    size = encoder.image_size
    shape = (3, 3, size, size) if size else (3, 12, encoder.channels)
    return torch.rand(shape, generator=torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def features(encoder, images) -> Features:
    with torch.no_grad():
        return encoder(images)


def test_tokens_and_summary_have_the_declared_shapes(encoder, features):
    assert features.tokens.ndim == 3
    assert features.tokens.shape[0] == 3
    assert features.tokens.shape[1] > 1
    assert features.tokens.shape[2] == encoder.channels
    assert features.summary.shape == (3, CONFIG["summary"])


def test_features_are_finite_floats_on_the_device_of_the_pictures(features):
    for part in features:
        assert part.dtype == torch.float32
        assert part.device.type == "cpu"
        assert part.isfinite().all()


def test_other_pictures_have_other_features(features):
    for part in features:
        assert (part[0] - part[1]).abs().max() > 1e-3


@torch.no_grad()
def test_the_same_pictures_have_the_same_features(encoder, images, features):
    for first, again in zip(features, encoder(images), strict=True):
        assert torch.equal(first, again)


@torch.no_grad()
def test_features_do_not_depend_on_the_rest_of_the_batch(encoder, images, features):
    for i in range(len(images)):
        for batch, single in zip(features, encoder(images[i : i + 1]), strict=True):
            torch.testing.assert_close(single[0], batch[i], **TOLERANCE)


def test_the_summary_trains_with_the_model(encoder, images):
    """The summary has at least one trained layer, because the first guess depends on the summary alone."""
    encoder(images).summary.square().sum().backward()
    assert any(weight.grad is not None and weight.grad.abs().max() > 0 for weight in encoder.parameters())
