"""The most memory that this process and its children hold together while something runs."""

import os
import threading
from pathlib import Path
from types import TracebackType

EVERY_S = 0.2


class PeakMemory:
    """A context manager; `megabytes` is the highest sum of resident memory seen, shared pages counted more than once.

    Linux alone: it reads /proc.
    """

    def __init__(self) -> None:
        self.megabytes = 0.0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> "PeakMemory":
        self._thread.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        while True:
            self.megabytes = max(self.megabytes, resident_megabytes(os.getpid()))
            if self._done.wait(EVERY_S):
                return


def resident_megabytes(process: int) -> float:
    """Resident memory of a process and all below it."""
    found = {pid: status for pid, status in map(_status, Path("/proc").glob("[0-9]*")) if status}
    family = {process}
    while more := {pid for pid, status in found.items() if status["PPid"] in family} - family:
        family |= more
    return sum(found[pid]["VmRSS"] for pid in family & found.keys()) / 1024


def _status(folder: Path) -> tuple[int, dict[str, int]]:
    """Parent and resident kilobytes of a process; nothing of one that has ended."""
    try:
        lines = (line.split() for line in (folder / "status").read_text().splitlines())
        return int(folder.name), {"VmRSS": 0} | {w[0][:-1]: int(w[1]) for w in lines if w[0] in ("PPid:", "VmRSS:")}
    except OSError:
        return int(folder.name), {}
