"""The log of a search: a line for every call of the generator, a plot, and pictures of the best so far."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from dipcg.files import locked, write_file, written

# The numbers of calls in the paper's figure 5.
MARKS = (100, 500, 1000, 2000, 5000, 10_000)
Tile = UInt8[np.ndarray, "s s 3"]


@dataclass(frozen=True)
class Line:
    """One call: seconds since the search began, its score, and the best so far."""

    seconds: float
    score: float
    best: float


class Trace:
    """`trace.jsonl` in a folder, beside the settings that every line depends on; an earlier one is continued.

    A context manager that holds the folder. Raises ValueError when the folder holds the trace of other settings, when
    the trace is damaged, and when another process searches there.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self.lines: list[Line] = []
        path = folder / "trace.jsonl"
        with contextlib.ExitStack() as opened:
            opened.enter_context(locked(folder, "searches"))
            _claim(folder, settings)
            for line in _read(path, _whole_lines) or []:
                self._append(line["seconds"], math.inf if line["score"] is None else line["score"])
            self._file = opened.enter_context(path.open("ab"))
            # What a kill or a full disk has left of a last line goes, and nothing else does.
            self._file.truncate(path.read_bytes().rfind(b"\n") + 1)
            self._opened = opened.pop_all()

    @property
    def scores(self) -> list[float]:
        return [line.score for line in self.lines]

    @property
    def seconds(self) -> float:
        return self.lines[-1].seconds if self.lines else 0.0

    def add(self, seconds: float, score: float) -> None:
        """Append one call, which is on disk when this returns."""
        self._file.write(_written(self._append(seconds, score)).encode())
        self._file.flush()

    def close(self) -> None:
        self._opened.close()

    def __enter__(self) -> Trace:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _append(self, seconds: float, score: float) -> Line:
        self.lines.append(Line(seconds, score, min(score, self.lines[-1].best if self.lines else math.inf)))
        return self.lines[-1]


def _claim(folder: Path, settings: dict[str, Any]) -> None:
    """Say in the folder which search it holds, or refuse one that holds another."""
    about = folder / "search.json"
    before = _read(about, json.loads)
    if before is None:
        return write_file(about, json.dumps(settings, indent=1))
    if before != settings:
        changed = ", ".join(key for key in settings if before.get(key) != settings[key])
        raise ValueError(f"{folder} holds another search (different {changed}); choose another folder or delete it.")
    return None


def _read(path: Path, parse: Callable[[str], Any]) -> Any:
    """What a file holds, or None where there is none; raises ValueError for a damaged one."""
    if not path.is_file():
        return None
    try:
        return parse(path.read_text())
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is damaged ({error}); correct it, delete it, or choose another folder.") from None


def _whole_lines(text: str) -> list[dict[str, Any]]:
    """All lines but the last if a kill has cut it short."""
    lines = [json.loads(line) for line in text.splitlines(keepends=True) if line.endswith("\n")]
    return [{key: line[key] for key in ("seconds", "score")} for line in lines]


def marks(calls: int) -> list[int]:
    """The numbers of calls at which a search of this length is shown."""
    return [mark for mark in MARKS if mark < calls] + [calls]


def plot_traces(traces: dict[str, Sequence[Line]], path: str | Path) -> None:
    """Plot the best score over calls and over seconds, a line for each search; needs matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise RuntimeError("Plots need matplotlib: run `pip install matplotlib`.") from None
    figure = Figure((9, 3.6), layout="constrained")
    over_calls, over_seconds = figure.subplots(1, 2, sharey=True)
    for name, lines in traces.items():
        best = [line.best for line in lines]
        over_calls.step(range(1, len(best) + 1), best, where="post", label=name)
        over_seconds.step([max(line.seconds, 1e-2) for line in lines], best, where="post", label=name)
    for axes, label in ((over_calls, "calls of the generator"), (over_seconds, "seconds")):
        axes.set(xlabel=label, xscale="log")
        axes.grid(alpha=0.3)
    over_calls.set_ylabel("best distance so far")
    over_calls.legend()
    with written(path) as unfinished:
        figure.savefig(unfinished, dpi=110)


def labelled(tile: Tile, text: str) -> UInt8[np.ndarray, "h s 3"]:
    """A tile with a line of text below."""
    import cv2

    side = tile.shape[1]
    strip, font, scale = np.full((side // 9, side, 3), 255, np.uint8), cv2.FONT_HERSHEY_SIMPLEX, side / 512
    (width, height), _ = cv2.getTextSize(text, font, scale, 1)
    at = ((side - width) // 2, (len(strip) + height) // 2)
    cv2.putText(strip, text, at, font, scale, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([tile, strip])


def _written(line: Line) -> str:
    score = line.score if math.isfinite(line.score) else None
    return json.dumps({"seconds": round(line.seconds, 3), "score": score}) + "\n"
