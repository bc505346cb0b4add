"""Threads that take work in the order of its priority, and do not let slow work keep the rest waiting."""

from __future__ import annotations

import heapq
import itertools
import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")

# The number of slow pieces of work that may run beside each quick one.
SLOW = 3


@dataclass
class _Running:
    """Work that runs: since when, infinity while it prepares itself; and what stops it."""

    began: float = math.inf
    stop: Callable[[], object] = lambda: None


class Turns:
    """Runs at most `most` pieces of work at a time; the lowest priority goes first, then the first that came.

    Work that takes longer than `patience_s` is slow: it no longer counts, so the next may start beside it. Where too
    many slow ones run and others wait, the slowest is stopped.
    """

    def __init__(self, most: int) -> None:
        self.patience_s = math.inf
        self.is_closed = False
        self._most = most
        self._waiting: list[tuple[int, int, Callable[[], Any], Future[Any]]] = []
        self._numbers = itertools.count()
        self._running: dict[int, _Running] = {}
        self._changed = threading.Condition()
        self._threads: list[threading.Thread] = []

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

    def begin(self, stop: Callable[[], object]) -> None:
        """Say that the work of this thread begins now, after what it had to prepare, and what stops it."""
        with self._changed:
            self._running[threading.get_ident()] = _Running(time.monotonic(), stop)
            self._changed.notify_all()

    @property
    def is_busy(self) -> bool:
        """Whether any work runs."""
        with self._changed:
            return bool(self._running)

    def close(self) -> None:
        """Cancel what waits, and take nothing more; what runs goes on."""
        with self._changed:
            self.is_closed = True
            waiting, self._waiting = self._waiting, []
            self._changed.notify_all()
        for *_, future in waiting:
            future.cancel()

    def _start_threads(self) -> None:
        if self._threads:
            return
        shares = self.patience_s < math.inf
        works = [self._run] * self._most * (1 + SLOW if shares else 1) + [self._watch] * shares
        self._threads = [threading.Thread(target=work, daemon=True, name="build") for work in works]
        for thread in self._threads:
            thread.start()

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
                        self._running[threading.get_ident()] = _Running()
                        return work, future
                    continue
                self._changed.wait(seconds if self._waiting and seconds < math.inf else None)
        return None

    def _watch(self) -> None:
        """Stop the slowest work where it keeps other work waiting."""
        with self._changed:
            while not self.is_closed:
                left = math.inf
                if self._waiting and len(self._running) == self._most * (1 + SLOW):
                    slowest = min(self._running.values(), key=lambda running: running.began)
                    left = max(0.0, slowest.began + self.patience_s - time.monotonic())
                    if left == 0:
                        slowest.stop()
                        slowest.began = math.inf
                self._changed.wait(left if left < math.inf else None)

    def _seconds_to_wait(self) -> float:
        """How long it takes until one of those that run is slow, if nothing ends; 0 when the next may start."""
        left = [running.began + self.patience_s - time.monotonic() for running in self._running.values()]
        quick = [seconds for seconds in left if seconds > 0]
        return 0.0 if len(quick) < self._most else min(quick)

    def _end(self) -> None:
        with self._changed:
            self._running.pop(threading.get_ident(), None)
            self._changed.notify_all()
