"""What is done for visitors and takes longer than a request: its state, and how it goes on."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Callable
from threading import RLock
from typing import Any, Literal

from dipcg.app.limits import JOBS, JOBS_OF_ONE, KEPT_S, MOST_JOBS
from dipcg.app.store import Store
from dipcg.workers.process import BuildError
from dipcg.workers.rpc import BlenderError

Kind = Literal["estimate", "asset"]
State = Literal["waiting", "running", "done", "failed", "cancelled"]
BUSY = "The server has too much to do; try again in a minute."


class Busy(RuntimeError):
    """The server has too much to do."""

    def __init__(self, sentence: str = BUSY) -> None:
        super().__init__(sentence)


class Job:
    """One job. Any thread may change it until it ends; `version` grows with each change."""

    def __init__(self, kind: Kind) -> None:
        self.id, self.kind = secrets.token_urlsafe(16), kind
        self.state: State = "waiting"
        self.share, self.note, self.version = 0.0, "", 0
        self.result: dict[str, Any] | None = None
        self.error: str | None = None
        self._stop: Callable[[], object] = lambda: None
        self._lock = RLock()

    @property
    def is_over(self) -> bool:
        return self.state in ("done", "failed", "cancelled")

    def report(self, share: float, note: str) -> None:
        """Say how far it is, and what is done next."""
        self._change(state="running", share=max(self.share, share), note=note)

    def show(self, result: dict[str, Any]) -> None:
        """Give a first result; the job goes on."""
        self._change(result=result)

    def finish(self, result: dict[str, Any]) -> None:
        self._change(state="done", share=1.0, note="", result=result)

    def fail(self, error: BaseException) -> None:
        self._change(state="failed", note="", error=sentence(error))

    def cancel(self) -> None:
        """Stop it; builds that wait are not built."""
        self._change(state="cancelled", note="")
        self._stop()

    def watch(self, stop: Callable[[], object]) -> None:
        """What stops the work for this job when it is cancelled."""
        self._stop = stop
        if self.is_over:
            self.cancel()

    def _change(self, **changes: Any) -> None:
        with self._lock:
            if not self.is_over:
                self.__dict__.update(changes)
                self.version += 1


class Jobs:
    """The jobs of all visitors."""

    def __init__(self) -> None:
        self._kept: Store[Job] = Store(KEPT_S, JOBS, JOBS_OF_ONE, drop=Job.cancel)
        self._open: set[Job] = set()
        self._lock = RLock()

    def add(self, kind: Kind, owner: str) -> Job:
        """A new job; raises Busy when too many wait."""
        with self._lock:
            self._open = {job for job in self._open if not job.is_over}
            if len(self._open) >= MOST_JOBS:
                raise Busy
            job = Job(kind)
            self._open.add(job)
        self._kept.add(job, 1, owner, job.id)
        return job

    def get(self, name: str) -> Job:
        """The job of an id; raises KeyError."""
        return self._kept.get(name)

    def sweep(self) -> None:
        self._kept.sweep()


def guarded(job: Job, work: Callable[[], None]) -> None:
    """Do work for a job that is not over; an error fails the job."""
    if job.is_over:
        return
    try:
        work()
    except Exception as error:
        job.fail(error)


def sentence(error: BaseException) -> str:
    """What a visitor is told about an error."""
    if isinstance(error, (ValueError, LookupError, BuildError, BlenderError, Busy, ModuleNotFoundError)):
        return str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    logging.error("A visitor's request failed.", exc_info=error)
    return f"Something went wrong here ({type(error).__name__}); the server's log has more."
