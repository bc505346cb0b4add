"""The schedule follows pictures, or the clock where that is further on; threads follow the machine."""

import pytest

from dipcg.config import TrainConfig, parse_count
from dipcg.training.schedule import Schedule
from dipcg.training.threads import threads_beside


def schedule(two_stages: bool = True, grows: bool = True, **config) -> Schedule:
    return Schedule(TrainConfig(**{"pictures": 1000, **config}), 128, two_stages, grows)


def test_a_starved_run_is_where_its_pictures_are():
    assert schedule().share(250, 1e9) == 0.25
    assert schedule().share(2000, 0) == 1


def test_with_a_limit_of_time_the_clock_counts_where_it_is_further_on():
    assert schedule(minutes=10).share(100, 300) == 0.5
    assert schedule(minutes=10).share(700, 300) == 0.7


def test_pictures_grow_to_the_full_size_and_the_denoiser_sees_no_other():
    plan = schedule(denoiser_share=0.2)
    sizes = [plan.size(share) for share in (0.0, 0.2, 0.4, 0.79, 0.8, 1.0)]
    assert sizes == [64, 96, 128, 128, 128, 128]
    first_at_full_size = next(share / 100 for share in range(100) if plan.size(share / 100) == 128)
    assert plan.rate(first_at_full_size) > 0.5
    assert [schedule(grows=False).size(share) for share in (0.0, 0.5)] == [128, 128]


def test_no_picture_is_smaller_than_64_pixels_unless_the_networks_own_are():
    sizes = [Schedule(TrainConfig(), side, True, True).size(0.0) for side in (32, 64, 96, 256)]
    assert sizes == [32, 64, 64, 128]


@pytest.mark.parametrize(("share", "expected"), [(0.0, False), (0.89, False), (0.9, True), (1.0, True)])
def test_the_denoiser_comes_last(share, expected):
    assert schedule().trains_denoiser(share) == expected
    assert schedule(two_stages=False).trains_denoiser(share)


def test_the_rate_rises_and_falls_in_each_stage():
    plan = schedule(denoiser_share=0.5)
    first = [plan.rate(share / 100) for share in range(50)]
    second = [plan.rate(share / 100) for share in range(50, 100)]
    assert first == pytest.approx(second)
    assert first[0] == 0
    assert max(first) > 0.95
    assert first[-1] < 0.02
    assert {schedule(schedule="constant").rate(share) for share in (0.0, 0.5, 1.0)} == {1.0}


def test_without_a_guess_there_is_one_stage():
    plan = schedule(two_stages=False)
    assert plan.rate(0.95) < plan.rate(0.5) < plan.rate(0.1)


@pytest.mark.parametrize(("text", "count"), [("500", 500), ("300k", 300_000), ("3m", 3_000_000), ("1.5M", 1_500_000)])
def test_a_number_of_pictures_is_read_as_people_write_it(text, count):
    assert parse_count(text) == count


@pytest.mark.parametrize("text", ["", "k", "0", "-3k", "three", "nan"])
def test_another_number_of_pictures_is_refused(text):
    with pytest.raises(ValueError, match="written like 300k or 3m"):
        parse_count(text)


@pytest.mark.parametrize(
    ("others", "processors", "threads"),
    [(0.0, 2, 2), (0.2, 2, 2), (1.0, 2, 1), (5.0, 2, 1), (3.0, 16, 13), (0.4, 1, 1)],
)
def test_a_busy_neighbour_gets_a_processor_for_itself(others, processors, threads):
    assert threads_beside(others, processors) == threads
