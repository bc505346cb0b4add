"""Intervals and paired differences of tables against SciPy's bootstrap, normal theory, and each other."""

import json

import numpy as np
import pytest
from scipy import stats

from dipcg.cli.terminal import differences
from dipcg.evaluation.tables import AGAINST, ESTIMATE, Table, bootstrap
from dipcg.metrics import load_metric

CASES = 80


@pytest.fixture
def table() -> Table:
    """Hard and easy cases, which all rows share; one row is a little worse in each, one has nothing to compare."""
    rng = np.random.default_rng(4)
    hard, table = rng.gamma(2.0, 0.05, CASES), Table([load_metric("chamfer"), load_metric("parameter_error")])
    for value in hard:
        table.add("other", {"chamfer": value + 0.01 + 0.005 * rng.standard_normal(), "parameter_error": 0.5})
        table.add("bound", {"chamfer": 0.01})
        table.add(ESTIMATE, {"chamfer": value, "parameter_error": 0.25})
    return table


def columns(table: Table) -> tuple[np.ndarray, np.ndarray]:
    other, own = (np.array(table.values[row]["chamfer"]) for row in ("other", ESTIMATE))
    return other, own


def test_paired_intervals_are_those_of_scipy(table):
    def statistic(a, b, axis):
        return a.mean(axis) - b.mean(axis)

    found = stats.bootstrap(
        columns(table), statistic, paired=True, method="percentile", n_resamples=9999, rng=np.random.default_rng(1)
    )
    mean, low, high = table.differences("chamfer")["other"]
    width = found.confidence_interval.high - found.confidence_interval.low
    assert mean == pytest.approx(statistic(*columns(table), 0))
    assert (low, high) == pytest.approx(tuple(found.confidence_interval), abs=0.08 * width)


def test_intervals_of_normal_values_are_those_of_normal_theory():
    values = np.random.default_rng(2).normal(3.0, 2.0, 400)
    half = 1.96 * values.std(ddof=1) / np.sqrt(len(values))
    assert bootstrap(values) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.08 * half)


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(3)
    found = [bootstrap(rng.normal(0.0, 1.0, 60)) for _ in range(300)]
    assert np.mean([low < 0 < high for low, high in found]) == pytest.approx(0.95, abs=0.04)


def test_pairing_shows_a_difference_that_separate_intervals_hide(table):
    other, own = table.interval("other", "chamfer"), table.interval(ESTIMATE, "chamfer")
    assert other[0] < own[1]
    _, low, high = table.differences("chamfer")["other"]
    assert low > 0
    assert high - low < (other[1] - other[0]) / 4


def test_equal_rows_differ_by_nothing(table):
    for value in table.values[ESTIMATE]["chamfer"]:
        table.add("again", {"chamfer": value})
    assert table.differences("chamfer")["again"] == (0, 0, 0)


def test_differences_are_of_rows_with_the_metric_and_of_tables_with_an_estimate(table):
    assert list(table.differences("chamfer")) == ["other", "bound"]
    assert list(table.differences("parameter_error")) == ["other"]
    del table.values[ESTIMATE]
    assert table.differences("chamfer") == {}
    assert differences(table) == ""


def test_json_has_every_difference_beside_its_row(table):
    found = json.loads(json.dumps(table.to_dict()))
    assert found["other"][AGAINST]["chamfer"] == list(table.differences("chamfer")["other"])
    assert found["other"][AGAINST]["parameter_error"] == [0.25, 0.25, 0.25]
    assert list(found["bound"][AGAINST]) == ["chamfer"]
    assert AGAINST not in found[ESTIMATE]


def test_the_printed_differences_are_of_the_first_metric(table):
    lines = differences(table).splitlines()
    mean, low, high = table.differences("chamfer")["other"]
    assert lines[0] == "| | chamfer, less the estimate's |"
    assert lines[2] == f"| other | {mean:+.3f} [{low:+.3f}, {high:+.3f}] |"
    assert len(lines) == 4
