"""Light meshes for the candidates of one job, so that no job keeps another waiting for long."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future

from dipcg.mesh import Mesh
from dipcg.space import Params
from dipcg.workers.process import BuildError

# Builds of one job that wait or run at once.
AT_ONCE = 2

Outcome = Mesh | BuildError


class Builds:
    """Builds many parameter sets, a few at a time; none after one that took too long, since the next might too.

    `then` is called once, with the mesh of each or the error in its place.
    """

    def __init__(
        self, submit: Callable[[Params], Future[Mesh]], many: Sequence[Params], then: Callable[[list[Outcome]], object]
    ) -> None:
        self._submit, self._many, self._then = submit, many, then
        self._outcomes: list[Outcome] = [BuildError("raised", "This was not built.", params) for params in many]
        self._running: dict[int, Future[Mesh]] = {}
        self._next, self._lock = 0, threading.RLock()

    def start(self) -> None:
        """Begin with the first few."""
        if not self._many:
            self._then([])
        for _ in range(AT_ONCE):
            self._begin()

    def cancel(self) -> None:
        """Begin no more, and cancel those that wait."""
        with self._lock:
            self._next = len(self._many)
            running = list(self._running.values())
        for build in running:
            build.cancel()

    def _begin(self) -> None:
        with self._lock:
            number = self._next
            if number >= len(self._many):
                return
            self._next += 1
            try:
                self._running[number] = build = self._submit(self._many[number])
            except RuntimeError:
                # The pool is closed, and the server ends.
                return
        build.add_done_callback(lambda build: self._done(number, build))

    def _done(self, number: int, build: Future[Mesh]) -> None:
        outcome = outcome_of(build)
        with self._lock:
            self._outcomes[number] = outcome
            del self._running[number]
            if isinstance(outcome, BuildError) and outcome.reason == "timeout":
                self._next = len(self._many)
        self._begin()
        with self._lock:
            over = not self._running and self._next >= len(self._many)
            # Two threads may end the last two at once.
            self._next += over
            first = over and self._next == len(self._many) + 1
        if first:
            self._then(self._outcomes)


def outcome_of(build: Future[Mesh]) -> Outcome:
    """The mesh of a build that is done, or the error in its place."""
    if build.cancelled():
        return BuildError("raised", "The build was cancelled.")
    error = build.exception()
    if error is None:
        return build.result()
    return error if isinstance(error, BuildError) else BuildError("raised", str(error))
