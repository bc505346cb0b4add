"""Estimates of several visitors: everybody sees a result before anybody's candidates are built."""

import time
from collections.abc import Callable

import pytest

from dipcg.app import estimating
from dipcg.app.estimating import Asked, Estimating
from dipcg.app.jobs import Job
from dipcg.app.pictures import Pictures
from dipcg.images import Cutout, ImageError, cut_out
from dipcg.inference.estimate import Options

OPTIONS = Options(generator="box", candidates=6, steps=2)


class Watched(Job):
    """A job that notes whether each of its results is ranked."""

    def __init__(self, seen: list[bool]) -> None:
        super().__init__("estimate")
        self.seen = seen

    def show(self, result: dict) -> None:
        self.seen.append(result["ranked"])
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


def start(running: Estimating, sources: list[Callable[[], Cutout]], seen: list[bool]) -> list[Job]:
    jobs: list[Job] = [Watched(seen) for _ in sources]
    for job, source in zip(jobs, sources, strict=True):
        running.start(Asked(job, source, OPTIONS, "somebody", thumbnails=False))
    return jobs


def finish(jobs: list[Job]) -> None:
    until = time.monotonic() + 120
    while not all(job.is_over for job in jobs):
        assert time.monotonic() < until
        time.sleep(0.05)


def test_everybody_has_a_result_before_anybodys_candidates_are_compared(running, picture):
    seen: list[bool] = []
    jobs = start(running, [lambda: cut_out(picture)] * 7, seen)
    finish(jobs)
    assert seen[:7] == [False] * 7
    assert all(seen[7:])
    assert [job.state for job in jobs] == ["done"] * 7


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
