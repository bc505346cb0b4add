"""One visitor's desk: what lies on it is changed in the order of asking, in whatever order requests come and end."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from threading import Lock

from dipcg.app.state import Work

MOST_REPLAYED = 100  # changes that can be done again after one that was asked for earlier

Change = Callable[[Work], Work]


@dataclass(frozen=True)
class Done:
    """A change with the turn at which the page asked for it, and the work that it was made to."""

    turn: int
    change: Change
    before: Work


class Desk:
    """The work of one visitor. Any thread may change it; the page numbers what it asks for, and that order counts.

    An estimate takes seconds, a request may be overtaken by the next: whatever was asked later is then done again.
    """

    def __init__(self) -> None:
        self.work = Work()
        self._done: list[Done] = []
        self._lock = Lock()

    def __deepcopy__(self, _: object) -> Desk:
        """A desk of its own for every visitor, which is how Gradio copies the first."""
        return Desk()

    def change(self, turn: int, change: Change) -> tuple[int, Work]:
        """Change the work as if it were asked at this turn; the new work, and a number that grows with every change.

        Raises what `change` raises, and leaves the work as it was. Later changes that no longer fit are left out.
        """
        with self._lock:
            later = self._take_back(turn)
            try:
                self._do(turn, change)
            finally:
                for done in later:
                    with suppress(ValueError):
                        self._do(done.turn, done.change)
            return next(_VERSIONS), self.work

    def _take_back(self, turn: int) -> list[Done]:
        later = [done for done in self._done if done.turn > turn]
        if later:
            self.work = later[0].before
            self._done = self._done[: -len(later)]
        return later

    def _do(self, turn: int, change: Change) -> None:
        before, self.work = self.work, change(self.work)
        self._done = [*self._done, Done(turn, change, before)][-MOST_REPLAYED:]


_VERSIONS = itertools.count(time.time_ns() // 1_000_000)  # grows over a restart too, as a page may outlive the server
