"""Estimates of several visitors: everybody sees the expected candidate, then all, before anybody's are built."""

import time
from collections.abc import Callable

import pytest

from dipcg.app import estimating
from dipcg.app.comparing import Asked
from dipcg.app.estimating import Estimating
from dipcg.app.jobs import Job
from dipcg.app.pictures import Pictures
from dipcg.images import Cutout, ImageError, cut_out
from dipcg.inference.estimate import Options

OPTIONS = Options(generator="box", candidates=6, steps=2)


Seen = list[tuple[int, bool]]


class Watched(Job):
    """A job that notes of each of its results how many candidates it has, and whether these are ranked."""

    def __init__(self, seen: Seen) -> None:
        super().__init__("estimate")
        self.seen = seen

    def show(self, result: dict) -> None:
        self.seen.append((len(result["candidates"]), result["ranked"]))
        super().show(result)


def unreadable() -> Cutout:
    raise ImageError("This is no picture.")


@pytest.fixture
def running(studio, monkeypatch):
    look = estimating.look_at_many
    # A busy machine takes long for each pass of the network.
    monkeypatch.setattr(estimating, "look_at_many", lambda *asked: time.sleep(0.3) or look(*asked))
    # Whoever waits for a result that never comes would wait for ever.
    monkeypatch.setattr(estimating, "YIELD_S", 10_000.0)
    running = Estimating(studio, Pictures())
    yield running
    running.close()


def start(running: Estimating, sources: list[Callable[[], Cutout]], seen: Seen) -> list[Job]:
    jobs: list[Job] = [Watched(seen) for _ in sources]
    for job, source in zip(jobs, sources, strict=True):
        running.start(Asked(job, source, OPTIONS, "somebody", thumbnails=False))
    return jobs


def finish(jobs: list[Job]) -> None:
    until = time.monotonic() + 120
    while not all(job.is_over for job in jobs):
        assert time.monotonic() < until
        time.sleep(0.05)


def test_everybody_sees_the_expected_candidate_first_and_all_before_anybodys_are_compared(running, picture):
    seen: Seen = []
    cutout = cut_out(picture)
    jobs = start(running, [lambda: cutout] * 7, seen)
    finish(jobs)
    assert seen[:14] == [(1, False)] * 7 + [(6, False)] * 7
    assert all(ranked for _, ranked in seen[14:])
    assert [job.state for job in jobs] == ["done"] * 7


def test_the_expected_candidate_is_the_same_with_the_others_and_says_nothing_about_its_spread(running, picture):
    results: list[dict] = []
    job = Job("estimate")
    job.show = lambda result: results.append(result)  # type: ignore[method-assign]
    running.start(Asked(job, lambda: cut_out(picture), OPTIONS, "somebody", thumbnails=False))
    finish([job])
    first, unranked = results[:2]
    assert first["candidates"][0]["params"] == pytest.approx(unranked["candidates"][0]["params"])
    assert first["spread"] == {}
    assert unranked["spread"]


def test_nobody_waits_for_a_result_that_never_comes(running, picture):
    given_up, *jobs = start(running, [lambda: cut_out(picture), unreadable, lambda: cut_out(picture)], [])
    given_up.cancel()
    finish(jobs)
    assert [job.state for job in jobs] == ["failed", "done"]


def test_nobody_waits_for_a_picture_that_the_network_alone_does_not_recognise(running, picture, monkeypatch):
    look = estimating.look_at_many
    monkeypatch.setattr(estimating, "look_at_many", lambda *asked: [*look(*asked)[:-1], None])
    jobs = start(running, [lambda: cut_out(picture)] * 7, [])
    finish(jobs)
    assert [job.state for job in jobs] == ["done"] * 7
