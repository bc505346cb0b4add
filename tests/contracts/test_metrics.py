"""The contract of metrics, checked for each registered metric and its variants."""

import numpy as np
import pytest

from dipcg import registry
from dipcg.generators import load_generator
from dipcg.metrics import Metric, load_metric, normalise

METRICS = [column for name in registry.names("metrics") for column in load_metric(name).columns]
# Standard deviations of the noise of points, in longest sides; the noise of `x` has ten times these.
NOISE = (0.0, 0.02, 0.08, 0.3)

metrics = pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)


def noisy_pair(metric: Metric, noise: float) -> tuple:
    """The arguments of `measure`: a random input, and the same input with noise."""
    rng = np.random.default_rng(0)
    if metric.compares == "points":
        a = normalise(rng.uniform(-0.5, 0.5, (700, 3)) * [1, 0.6, 0.3])
        return a, a + noise * rng.normal(size=a.shape)
    space = load_generator("box").space
    truth = space.sample(rng)
    x = space.encode(truth) + 10 * noise * rng.normal(size=len(space))
    return space, truth, space.decode(x.clip(-1, 1))


def loss(metric: Metric, noise: float) -> float:
    """The value of the metric, negated where higher is better."""
    value = metric.measure(*noisy_pair(metric, noise))
    return value if metric.better == "lower" else -value


@metrics
def test_declarations_are_valid(metric):
    assert metric.unit
    assert metric.better in ("lower", "higher")
    assert metric.compares in ("points", "params")
    assert metric.points >= 1000


@metrics
def test_is_best_on_identical_input(metric):
    best = 0.0 if metric.better == "lower" else 1.0
    assert metric.measure(*noisy_pair(metric, 0.0)) == pytest.approx(best, abs=1e-12)


@metrics
def test_worsens_as_noise_grows(metric):
    losses = [loss(metric, noise) for noise in NOISE]
    assert losses == sorted(losses)
    assert losses[-1] > losses[0] + 1e-3


@metrics
def test_no_value_is_worse_than_the_declared_worst(metric):
    worst = metric.worst if metric.better == "lower" else -metric.worst
    assert loss(metric, NOISE[-1]) <= worst


@pytest.mark.parametrize("metric", [m for m in METRICS if m.symmetric], ids=lambda metric: metric.name)
def test_is_symmetric_where_declared(metric):
    a, b = noisy_pair(metric, 0.1)
    assert metric.measure(a, b) == pytest.approx(metric.measure(b, a), rel=1e-9)


@metrics
def test_the_same_input_gives_the_same_value(metric):
    assert loss(metric, 0.08) == loss(metric, 0.08)
