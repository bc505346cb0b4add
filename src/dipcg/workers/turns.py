"""Threads that take work in the order of its priority, and do not let slow work keep the rest waiting."""

from __future__ import annotations

import heapq
import itertools
import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

T = TypeVar("T")

# Seconds after which work is slow: it no longer counts as one of those that run, so that the next may start.
PATIENCE_S = 2.0
# The number of slow pieces of work that may run beside each quick one.
SLOW = 3


class Turns:
    """Runs at most `most` pieces of work at a time, and slow ones beside them; the lowest priority goes first."""

    def __init__(self, most: int, patience_s: float = PATIENCE_S) -> None:
        self._most, self._patience_s = most, patience_s
        self._waiting: list[tuple[int, int, Callable[[], Any], Future[Any]]] = []
        self._numbers = itertools.count()
        # By thread, the time at which the work began that it runs; infinity while it prepares itself.
        self._began: dict[int, float] = {}
        self._changed = threading.Condition()
        self._threads: list[threading.Thread] = []
        self.is_closed = False

    def submit(self, work: Callable[[], T], priority: int = 0) -> Future[T]:
        """Let the work run when its turn comes; raises RuntimeError when this is closed."""
        future: Future[T] = Future()
        with self._changed:
            if self.is_closed:
                raise RuntimeError("This pool is closed.")
            heapq.heappush(self._waiting, (priority, next(self._numbers), work, future))
            self._start_threads()
            self._changed.notify_all()
        return future

    def begin(self) -> None:
        """Say that the work of this thread begins now, after what it had to prepare."""
        with self._changed:
            self._began[threading.get_ident()] = time.monotonic()
            self._changed.notify_all()

    @property
    def is_busy(self) -> bool:
        """Whether any work runs."""
        with self._changed:
            return bool(self._began)

    def close(self) -> None:
        """Cancel what waits, and take nothing more; what runs goes on."""
        with self._changed:
            self.is_closed = True
            for *_, future in self._waiting:
                future.cancel()
            self._waiting.clear()
            self._changed.notify_all()

    def _start_threads(self) -> None:
        while len(self._threads) < self._most * (1 + SLOW):
            self._threads.append(threading.Thread(target=self._run, daemon=True, name="build"))
            self._threads[-1].start()

    def _run(self) -> None:
        while taken := self._take():
            work, future = taken
            try:
                future.set_result(work())
            except BaseException as error:
                future.set_exception(error)
            finally:
                # Neither holds a mesh while the thread waits.
                del work, future, taken
                self._end()

    def _take(self) -> tuple[Callable[[], Any], Future[Any]] | None:
        """The next work, when it may run; None when this is closed."""
        with self._changed:
            while not self.is_closed:
                seconds = self._seconds_to_wait()
                if self._waiting and seconds == 0:
                    *_, work, future = heapq.heappop(self._waiting)
                    if future.set_running_or_notify_cancel():
                        self._began[threading.get_ident()] = math.inf
                        return work, future
                    continue
                self._changed.wait(seconds if self._waiting and seconds < math.inf else None)
        return None

    def _seconds_to_wait(self) -> float:
        """How long it takes until one of those that run is slow, if nothing ends; 0 when the next may start."""
        left = [began + self._patience_s - time.monotonic() for began in self._began.values()]
        quick = [seconds for seconds in left if seconds > 0]
        return 0.0 if len(quick) < self._most else min(quick)

    def _end(self) -> None:
        with self._changed:
            self._began.pop(threading.get_ident(), None)
            self._changed.notify_all()
