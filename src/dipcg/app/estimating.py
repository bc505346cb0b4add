"""Estimates for many visitors at once: one pass of the network for several that wait.

A job passes through these stages, and waits for another visitor's build in none of them:
1. Two threads cut objects out.
2. One thread runs the network, on a few pictures that wait by then. The expected candidate is shown.
3. When nobody waits for that any more, the same thread draws the other candidates. All are shown, unranked.
4. Its candidates are built and compared with the picture (`comparing.py`).

Stage 4 takes the processor from the others, so it waits for a while until everybody has an unranked result.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from dipcg.app.comparing import Asked, Comparing
from dipcg.app.jobs import Job, guarded
from dipcg.app.pictures import Pictures
from dipcg.app.results import as_answer
from dipcg.app.studio import Studio
from dipcg.images import Cutout
from dipcg.inference.estimate import Result, describe, look, look_at_many

# Pictures in one pass of the network: with more, the first would wait for the last, and none is faster.
BATCH = 4
# Seconds after its unranked result in which a job lets the unranked results of others go first.
YIELD_S = 20.0


class Estimating:
    """The threads that estimate."""

    def __init__(self, studio: Studio, pictures: Pictures) -> None:
        self._studio, self._pictures = studio, pictures
        self._cutting = ThreadPoolExecutor(2, thread_name_prefix="cut")
        self._comparing = Comparing(studio, self._let_others_first)
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
        self._cutting.shutdown(cancel_futures=True)
        self._comparing.close()
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
                self._comparing.later(asked, partial(self._look_alone, asked))
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
        self._comparing.start(asked, result)

    def _wait_no_more_for(self, asked: Asked) -> None:
        with self._changed:
            self._unanswered.discard(asked.job)
            self._changed.notify_all()

    def _let_others_first(self, asked: Asked) -> None:
        """Wait until everybody has an unranked result, but not for long."""
        with self._changed:
            while not self._closed and self._anybody_waits() and time.monotonic() < asked.yields_until:
                self._changed.wait(0.1)

    def _anybody_waits(self) -> bool:
        # Some have failed or were given up.
        self._unanswered = {job for job in self._unanswered if not job.is_over}
        return bool(self._unanswered)
