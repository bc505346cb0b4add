"""Builds in child processes, which are kept running, replaced before they slow down, and stopped when they hang.

Blender only ever runs in these. A child is `python -m dipcg.workers.child` and not a fork of the caller: no `__main__`
guard is needed in the caller's script, and neither torch nor an OpenGL context is carried along.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from functools import partial
from typing import NamedTuple

from dipcg.generators import Detail, Generator, load_generator
from dipcg.mesh import Mesh
from dipcg.space import Params
from dipcg.workers.process import NO_MESSAGE, BuildError, Child
from dipcg.workers.turns import Turns

# Builds per worker that `timed` keeps waiting or done, so that no worker idles.
AHEAD = 4
STOPPED = "The build took too long while others waited, and was stopped."


class Built(NamedTuple):
    """Parameters with their mesh, or with the error in its place, and the seconds that the worker took."""

    params: Params
    mesh: Mesh | BuildError
    seconds: float | None = None
    """None for a failed build"""


class BuildPool:
    """`workers` child processes that build meshes of one generator; use it as a context manager.

    A build that takes longer than `timeout_s` fails, and the others go on. Processes start at their first use.
    Raises LookupError for an unknown generator and ModuleNotFoundError when a package it needs is not installed.
    """

    def __init__(self, generator: Generator | str, workers: int = 1, timeout_s: float = 60.0) -> None:
        self.generator = load_generator(generator) if isinstance(generator, str) else generator
        self.generator.check_installed()
        self.timeout_s = timeout_s
        self._children: set[Child] = set()
        self._given_up: set[Child] = set()
        # Children without work. The last that worked is used first, so that no more run than are needed.
        self._idle: list[Child] = []
        self._turns = Turns(workers)
        self._workers = workers

    def share(self, patience_s: float) -> None:
        """Let builds that take longer than this keep no others waiting; call it before the first build.

        Another process builds beside a slow one, and where too many are slow the slowest is stopped.
        """
        self._turns.patience_s = patience_s

    def build(self, params: Params, detail: Detail = "full") -> Mesh:
        """Build one mesh; raises BuildError with a sentence."""
        return self.submit(params, detail).result()

    def submit(self, params: Params, detail: Detail = "full", priority: int = 0, tries: int = 1) -> Future[Mesh]:
        """Start one build; the future's result is the mesh or a BuildError. Lower priorities are built first.

        With two `tries` a build whose worker died is tried once more, since the cause may lie outside of it.
        """
        return self._turns.submit(lambda: self._try(params, detail, tries), priority)

    def map(self, many: Iterable[Params], detail: Detail = "light") -> Iterator[Mesh | BuildError]:
        """Build many in parallel, in order; the error of a failed one stands in its place.

        Only a few are read and built ahead of what has been taken, so `many` may be endless.
        """
        return (built.mesh for built in self.timed(many, detail))

    def timed(self, many: Iterable[Params], detail: Detail = "light") -> Iterator[Built]:
        """As `map`, each with its parameters and the seconds that its worker took."""
        ahead: deque[tuple[Params, Future[tuple[Mesh, float]]]] = deque()
        for params in many:
            ahead.append((params, self._turns.submit(lambda params=params: self._build(params, detail))))
            if len(ahead) > AHEAD * self._workers:
                yield _outcome(*ahead.popleft())
        while ahead:
            yield _outcome(*ahead.popleft())

    def warm(self) -> None:
        """Start every worker in the background, so that the first build need not wait."""
        self._idle += [self._new_child() for _ in range(self._workers - len(self._children))]

    def close(self) -> None:
        """Stop all workers at once."""
        self._turns.close()
        # A build that is just starting may start one more child.
        while self._children or self._turns.is_busy:
            for child in list(self._children):
                self._discard(child)
            time.sleep(0.01)

    def __enter__(self) -> BuildPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _try(self, params: Params, detail: Detail, tries: int) -> Mesh:
        try:
            return self._build(params, detail)[0]
        except BuildError as error:
            if error.reason != "crashed" or tries == 1 or self._turns.is_closed:
                raise
        return self._try(params, detail, tries - 1)

    def _build(self, params: Params, detail: Detail) -> tuple[Mesh, float]:
        child = self._idle_child()
        try:
            child.start()
            self._turns.begin(partial(self._give_up, child))
            started = time.perf_counter()
            # Another Blender has no packages that reduce a mesh.
            foreign = bool(self.generator.blender)
            mesh = child.request((params, "full" if foreign else detail), self.timeout_s)
            seconds = time.perf_counter() - started
            if not isinstance(mesh, Mesh):
                raise BuildError("crashed", NO_MESSAGE)
            mesh = self.generator.reduced(mesh, detail) if foreign else mesh
        except BuildError as error:
            given_up = child in self._given_up
            reason, words = ("timeout", STOPPED) if given_up else (error.reason, str(error))
            self._put_back(child, reason in ("raised", "unusable"))
            raise BuildError(reason, words, params, self.generator.ref) from None
        self._put_back(child, child.builds < self.generator.recycle_after)
        return mesh, seconds

    def _idle_child(self) -> Child:
        try:
            return self._idle.pop()
        except IndexError:
            return self._new_child()

    def _new_child(self) -> Child:
        child = Child(self.generator.ref, blender=self.generator.blender)
        self._children.add(child)
        return child

    def _put_back(self, child: Child, usable: bool) -> None:
        """Keep a child for the next build, unless there are enough without it."""
        if usable and len(self._idle) < self._workers:
            self._idle.append(child)
        else:
            self._discard(child)

    def _give_up(self, child: Child) -> None:
        self._given_up.add(child)
        child.kill()

    def _discard(self, child: Child) -> None:
        child.stop()
        self._children.discard(child)
        self._given_up.discard(child)


def _outcome(params: Params, future: Future[tuple[Mesh, float]]) -> Built:
    try:
        return Built(params, *future.result())
    except BuildError as error:
        return Built(params, error)
