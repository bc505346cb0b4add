"""Several pictures of one object: their combined estimate does not depend on their order and is more certain."""

import numpy as np
import pytest
import torch

from dipcg.camera import VIEW_NUMBERS
from dipcg.config import ModelConfig
from dipcg.generators import load_generator
from dipcg.model.denoiser import Prediction
from dipcg.model.estimators import Estimator
from dipcg.model.sampling import agreed
from dipcg.pipeline import Inverter

BOX = load_generator("box")


@pytest.fixture(scope="module")
def inverter() -> Inverter:
    torch.manual_seed(0)
    model = Estimator(BOX.space, ModelConfig(width=24, depth=1, heads=2, summary=16))
    torch.nn.init.normal_(model.denoiser.read, std=0.3)
    torch.nn.init.normal_(model.denoiser.read_options, std=0.3)
    return Inverter(model, BOX)


def pictures(count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    images = np.full((count, 64, 64, 4), 255, np.uint8)
    images[:, 8:56, 8:56, :3] = rng.integers(0, 256, (count, 48, 48, 3))
    return list(images)


def test_one_view_gives_the_estimate_of_a_single_picture(inverter):
    (image,) = pictures(1)
    assert inverter.estimate_views([image], 3).candidates == inverter.estimate(image, 3).candidates


def test_the_order_of_pictures_changes_the_camera_alone(inverter):
    first, second, third = pictures(3)
    one, other = (inverter.estimate_views(order, 1) for order in ([first, second, third], [third, first, second]))
    for name in BOX.space.names:
        assert one.params[name] == pytest.approx(other.params[name]), name
    assert one.view != other.view


def test_an_estimate_without_pictures_is_refused(inverter):
    with pytest.raises(ValueError, match="at least one picture"):
        inverter.estimate_views([])


def test_reals_are_averaged_and_the_probabilities_of_choices_multiplied(inverter):
    outputs, rng = inverter.model.outputs, torch.Generator().manual_seed(0)
    raw = torch.randn(2, outputs.numbers, generator=rng)
    both = outputs(raw)
    combined = agreed(outputs, both, views=2)
    reals = BOX.space.reals
    torch.testing.assert_close(combined.mean[0, reals], both.mean[:, reals].mean(0))
    torch.testing.assert_close(combined.mean[:, -VIEW_NUMBERS:], both.mean[:, -VIEW_NUMBERS:])
    owner = BOX.space.names.index("top")
    options = outputs.owner == owner
    probabilities = torch.softmax(raw[:, outputs.dimension :][:, options], 1).prod(0)
    expected = (probabilities / probabilities.sum() * outputs.centres[options]).sum()
    torch.testing.assert_close(combined.mean[0, owner], expected)


def test_the_same_prediction_for_several_views_is_more_certain(inverter):
    outputs = inverter.model.outputs
    raw = torch.randn(1, outputs.numbers, generator=torch.Generator().manual_seed(1)).repeat(3, 1)
    alone, together = outputs(raw), agreed(outputs, outputs(raw), views=3)

    def highest_probability(prediction: Prediction) -> torch.Tensor:
        return outputs.log_probabilities(prediction.logits).exp()[0].amax()

    assert highest_probability(together) > highest_probability(alone)
