"""Candidates of many visitors, built by the workers and compared with their pictures; nobody waits for another's build.

1. The first four candidates are built and compared, and the result is shown.
2. The others are built when the workers have nothing else to do, and compared.
3. The first is corrected once, in the same way.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

from dipcg.app.building import Builds, Outcome
from dipcg.app.jobs import Job, guarded
from dipcg.app.results import Judged, as_answer, improve, judge
from dipcg.app.studio import Studio
from dipcg.images import Cutout
from dipcg.inference.again import corrections
from dipcg.inference.estimate import Options, Result
from dipcg.pipeline import Candidate
from dipcg.workers.process import BuildError

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


class Comparing:
    """The threads that compare; `let_others_first` waits while the processor is needed for what is more urgent."""

    def __init__(self, studio: Studio, let_others_first: Callable[[Asked], None]) -> None:
        self._studio, self._let_others_first = studio, let_others_first
        self._threads = ThreadPoolExecutor(2, thread_name_prefix="compare")

    def start(self, asked: Asked, result: Result) -> None:
        """Begin with a result that the network gives."""
        self.later(asked, partial(self._build_first, asked, result))

    def later(self, asked: Asked, work: Callable[[], None]) -> None:
        """Do this in one of the threads that compare, when others may wait for it."""
        # Builds may end after this is closed.
        with contextlib.suppress(RuntimeError):
            self._threads.submit(guarded, asked.job, partial(self._work, asked, work))

    def close(self) -> None:
        """Stop after what is being done."""
        self._threads.shutdown(cancel_futures=True)

    def _build_first(self, asked: Asked, result: Result) -> None:
        asked.job.report(0.3, "Building and comparing the candidates")
        candidates = result.estimate.candidates
        first = replace(result, estimate=replace(result.estimate, candidates=candidates[:FIRST]))
        self._build(first, SOON, partial(self._compare_first, asked, first, candidates[FIRST:]), asked)

    def _build(self, result: Result, priority: int, then: Callable[[list[Outcome]], None], asked: Asked) -> None:
        """Build the candidates without a mesh, and let a thread go on with the meshes, or the errors, of all."""
        name, waiting = result.estimate.generator, [c.params for c in result.estimate.candidates if c.mesh is None]
        submit = partial(self._studio.submit, name, detail="light", priority=priority)
        builds = Builds(submit, waiting, lambda built: self.later(asked, partial(then, built)))
        asked.job.watch(builds.cancel)
        builds.start()

    def _work(self, asked: Asked, work: Callable[[], None]) -> None:
        self._let_others_first(asked)
        work()

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
