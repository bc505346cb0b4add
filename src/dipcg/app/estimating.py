"""Estimates for many visitors at once: one pass of the network for all that wait, the likeliest candidates built first.

A job passes through these stages, and waits for another visitor's build in none of them:
1. Two threads cut objects out.
2. One thread runs the network, on a few pictures that wait by then. The expected candidate is shown.
3. When nobody waits for that any more, the same thread draws the other candidates. All are shown, unranked.
4. The workers build the first four candidates, two threads compare them with the picture, and the result is shown.
5. The workers build the others when they have nothing else to do, and the same threads compare them.
6. The first is corrected once, in the same way.

Stages 4 and 5 take the processor from the others, so they wait for a while until everybody has an unranked result.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from dipcg.app.building import Builds, Outcome
from dipcg.app.jobs import Job, guarded
from dipcg.app.pictures import Pictures
from dipcg.app.results import Judged, as_answer, improve, judge
from dipcg.app.studio import Studio
from dipcg.images import Cutout
from dipcg.inference.again import corrections
from dipcg.inference.estimate import Options, Result, describe, look, look_at_many
from dipcg.pipeline import Candidate
from dipcg.workers.process import BuildError

# Pictures in one pass of the network: with more, the first would wait for the last, and none is faster.
BATCH = 4
# Seconds after its unranked result in which a job lets the unranked results of others go first.
YIELD_S = 20.0
# Candidates that are built before the others, and the priorities of both; what a visitor edits comes before either.
FIRST, SOON, LATER = 4, 1, 2
NONE_BUILT = "None of the candidates could be built; try another picture or another seed."


@dataclass
class Asked:
    """One estimate that a visitor waits for."""

    job: Job
    source: str | Callable[[], Cutout]
    """a sentence, or what cuts the object out"""
    options: Options
    owner: str
    thumbnails: bool = True
    cutout: Cutout | None = None
    picture: str | None = None
    """the id of the cut-out"""
    is_expected_shown: bool = False
    yields_until: float = 0.0

    @property
    def now(self) -> Options:
        """The options of the next pass of the network: the expected candidate alone, or all."""
        return self.options if self.is_expected_shown else replace(self.options, candidates=1)


class Estimating:
    """The threads that estimate."""

    def __init__(self, studio: Studio, pictures: Pictures) -> None:
        self._studio, self._pictures = studio, pictures
        self._cutting = ThreadPoolExecutor(2, thread_name_prefix="cut")
        self._judging = ThreadPoolExecutor(2, thread_name_prefix="judge")
        # Those whose expected candidate is not shown yet, and those who wait for the others.
        self._waiting: deque[Asked] = deque()
        self._waiting_for_others: deque[Asked] = deque()
        # Those without an unranked result of all candidates yet.
        self._unanswered: set[Job] = set()
        self._changed = threading.Condition()
        self._closed = False
        self._network = threading.Thread(target=self._run_network, name="network", daemon=True)
        self._network.start()

    def start(self, asked: Asked) -> None:
        """Begin; the job says how it goes on."""
        with self._changed:
            self._unanswered.add(asked.job)
        if isinstance(asked.source, str):
            self._await_network(asked)
        else:
            self._cutting.submit(guarded, asked.job, partial(self._cut, asked, asked.source))

    def place(self, job: Job) -> int | None:
        """How many wait for the network before a job, if it waits too."""
        with self._changed:
            return next((number for number, asked in enumerate(self._waiting) if asked.job is job), None)

    def close(self) -> None:
        """Stop after what is being done."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for threads in (self._cutting, self._judging):
            threads.shutdown(cancel_futures=True)
        self._network.join()

    def _cut(self, asked: Asked, source: Callable[[], Cutout]) -> None:
        asked.job.report(0.05, "Looking at the picture")
        asked.cutout = source()
        asked.picture, _ = self._pictures.add(asked.cutout, asked.owner)
        self._await_network(asked)

    def _await_network(self, asked: Asked) -> None:
        with self._changed:
            (self._waiting_for_others if asked.is_expected_shown else self._waiting).append(asked)
            self._changed.notify_all()

    def _run_network(self) -> None:
        while taken := self._take():
            words = [asked for asked in taken if asked.cutout is None]
            pictures = [asked for asked in taken if asked.cutout is not None]
            for asked in words:
                guarded(asked.job, partial(self._describe, asked))
            if pictures:
                self._look(pictures)

    def _take(self) -> list[Asked]:
        """The next that wait for the network; empty when this is closed."""
        with self._changed:
            while not (waiting := self._waiting or self._waiting_for_others) and not self._closed:
                self._changed.wait()
            count = 0 if self._closed else min(BATCH, len(waiting))
            taken = [waiting.popleft() for _ in range(count)]
        return [asked for asked in taken if not asked.job.is_over] or ([] if self._closed else self._take())

    def _describe(self, asked: Asked) -> None:
        assert isinstance(asked.source, str)
        self._looked(asked, describe(asked.source, self._studio.text_inverters, asked.now, asked.job.report))

    def _look(self, many: Sequence[Asked]) -> None:
        for asked in many:
            asked.job.report(0.1, "Estimating the parameters")
        pictures: Any = [(asked.cutout, asked.now) for asked in many]
        try:
            results = look_at_many(pictures, self._studio.inverters)
        except Exception:
            # One of them cannot be estimated. Each alone says which.
            results = [None] * len(many)
        for asked, result in zip(many, results, strict=True):
            if result is None:
                # This takes builds, as what follows a result does, so nobody waits for it.
                self._wait_no_more_for(asked)
                self._judge_later(asked, partial(self._look_alone, asked))
            else:
                guarded(asked.job, partial(self._looked, asked, result))

    def _look_alone(self, asked: Asked) -> None:
        assert asked.cutout is not None
        self._show_unranked(asked, look([asked.cutout], self._studio.inverters, asked.options, asked.job.report))

    def _looked(self, asked: Asked, result: Result) -> None:
        """Show what the network says; after the expected candidate the others are drawn."""
        if asked.is_expected_shown or asked.options.candidates == 1:
            return self._show_unranked(asked, result)
        asked.job.show(as_answer(result, asked.picture))
        asked.is_expected_shown = True
        self._await_network(asked)

    def _show_unranked(self, asked: Asked, result: Result) -> None:
        """Show all candidates, and have the first of them built."""
        asked.job.show(as_answer(result, asked.picture))
        asked.yields_until = time.monotonic() + YIELD_S
        self._wait_no_more_for(asked)
        self._judge_later(asked, partial(self._build_first, asked, result))

    def _wait_no_more_for(self, asked: Asked) -> None:
        with self._changed:
            self._unanswered.discard(asked.job)
            self._changed.notify_all()

    def _build_first(self, asked: Asked, result: Result) -> None:
        asked.job.report(0.3, "Building and comparing the candidates")
        candidates = result.estimate.candidates
        first = replace(result, estimate=replace(result.estimate, candidates=candidates[:FIRST]))
        self._build(first, SOON, partial(self._compare_first, asked, first, candidates[FIRST:]), asked)

    def _build(self, result: Result, priority: int, then: Callable[[list[Outcome]], None], asked: Asked) -> None:
        """Build the candidates without a mesh, and let a thread go on with the meshes, or the errors, of all."""
        name, waiting = result.estimate.generator, [c.params for c in result.estimate.candidates if c.mesh is None]
        submit = partial(self._studio.submit, name, detail="light", priority=priority)
        builds = Builds(submit, waiting, lambda built: self._judge_later(asked, partial(then, built)))
        asked.job.watch(builds.cancel)
        builds.start()

    def _judge_later(self, asked: Asked, work: Callable[[], None]) -> None:
        # Builds may end after this is closed.
        with contextlib.suppress(RuntimeError):
            self._judging.submit(guarded, asked.job, partial(self._after_first_results, asked, work))

    def _after_first_results(self, asked: Asked, work: Callable[[], None]) -> None:
        with self._changed:
            while not self._closed and self._anybody_waits() and time.monotonic() < asked.yields_until:
                self._changed.wait(0.1)
        work()

    def _anybody_waits(self) -> bool:
        # Some have failed or were given up.
        self._unanswered = {job for job in self._unanswered if not job.is_over}
        return bool(self._unanswered)

    def _compare_first(self, asked: Asked, result: Result, others: list[Candidate], built: list[Outcome]) -> None:
        found = judge(result, built, self._studio, asked.thumbnails)
        if not others:
            return self._look_again(asked, found)
        if found.result.estimate.candidates:
            asked.job.show(as_answer(found.result, asked.picture, found))
        asked.job.report(0.6, "Building and comparing more candidates")
        every = [*found.result.estimate.candidates, *others]
        rest = replace(found.result, estimate=replace(found.result.estimate, candidates=every))
        self._build(rest, LATER, partial(self._compare_rest, asked, rest), asked)

    def _compare_rest(self, asked: Asked, result: Result, built: list[Outcome]) -> None:
        self._look_again(asked, judge(result, built, self._studio, asked.thumbnails))

    def _look_again(self, asked: Asked, found: Judged) -> None:
        """Correct the first candidate once; words show no picture that it could be corrected by."""
        estimate = found.result.estimate
        again = corrections(estimate, self._studio.find(estimate.generator)) if asked.cutout is not None else []
        if not again:
            return self._finish(asked, found)
        asked.job.show(as_answer(found.result, asked.picture, found))
        asked.job.report(0.9, "Looking again")
        unbuilt = replace(found.result, estimate=replace(estimate, candidates=again))
        self._build(unbuilt, LATER, partial(self._compare_again, asked, found, again), asked)

    def _compare_again(self, asked: Asked, found: Judged, again: list[Candidate], built: list[Outcome]) -> None:
        self._finish(asked, improve(found, again, built, self._studio, asked.thumbnails))

    def _finish(self, asked: Asked, found: Judged) -> None:
        if not found.result.estimate.candidates:
            raise BuildError("raised", NONE_BUILT)
        asked.job.finish(as_answer(found.result, asked.picture, found))
