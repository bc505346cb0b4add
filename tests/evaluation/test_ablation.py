"""The rows of the table of ablations: each is a training that `dipcg train` accepts, with one thing changed."""

from functools import wraps

import pytest
from benchmarks.ablation import PUBLISHED, ROWS, orders

from dipcg.cli import commands, main
from dipcg.config import ModelConfig, TrainConfig
from dipcg.generators import load_generator
from dipcg.model.estimators import build_estimator


def settings(flags, monkeypatch) -> tuple[TrainConfig, ModelConfig]:
    """What `dipcg train` would train with these flags."""
    found = []

    @wraps(commands.train)
    def recorded(generator, /, *, train, model, **_) -> None:
        found.append((train, model))

    monkeypatch.setattr(commands, "train", recorded)
    main(["train", "chair", "--data", "data", *flags])
    (one,) = found
    return one


@pytest.mark.parametrize("name", [*ROWS, *PUBLISHED])
def test_every_row_is_a_training_of_its_own(name, monkeypatch):
    ours = settings(ROWS["all"].flags, monkeypatch)
    assert (settings((ROWS | PUBLISHED)[name].flags, monkeypatch) == ours) == (name == "all")


def test_rows_of_sizes_are_smaller_and_larger_as_in_the_paper(monkeypatch):
    space = load_generator("chair").space
    weights = {
        name: sum(
            weight.numel()
            for weight in build_estimator(space, settings(ROWS[name].flags, monkeypatch)[1]).denoiser.parameters()
        )
        for name in ("small", "all", "large")
    }
    assert weights["small"] < weights["all"] / 3
    assert weights["large"] > 3 * weights["all"]


def test_orders_name_the_rows_that_both_tables_have():
    found = {"all": 0.05, "large": 0.04, "small": 0.06, "the paper's objective": 0.01}
    assert orders(found).splitlines() == [
        "Order here: large; all; small.",
        "Order in the paper: all; large; small.",
    ]
