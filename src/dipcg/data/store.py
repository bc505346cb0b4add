"""Data sets on disk: a folder of shards that a build fills, resumes and extends, and its reader.

A shard is written whole or not at all, and sample `i` depends on the seed and `i` alone, so a build that was killed
anywhere goes on with the same rows.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
import pyarrow as pa

from dipcg.data import shards
from dipcg.data.draws import Drawing, Draws
from dipcg.data.shards import FAILURE, NUMBER, Sample
from dipcg.files import locked, write_file
from dipcg.generators import load_generator
from dipcg.space import Parameter, ParameterSpace, Real
from dipcg.workers.pool import BuildPool, Built
from dipcg.workers.process import BuildError

# Samples in a shard.
SHARD = 250
# First and last twentieth of each split, by the number of the sample.
SPLITS = {"train": (0, 18), "validation": (18, 19), "test": (19, 20)}
# When so many builds fail from the start, none will work.
HOPELESS = 20
# Bins of a parameter's histogram.
BINS = 16


@dataclass(frozen=True)
class Progress:
    """How far a build is, for a progress bar."""

    done: int
    total: int
    failed: int
    new: int = 0
    """how many of those done this run has built"""


class Counts:
    """Counts the samples that are done and reports each change."""

    def __init__(self, total: int, report: Callable[[Progress], None], done: int, failed: int) -> None:
        self.total, self.report, self.before, self.done, self.failed = total, report, done, done, failed

    def add(self, done: int, failed: int) -> None:
        """Count some more samples."""
        self.done, self.failed = self.done + done, self.failed + failed
        self.report(Progress(self.done, self.total, self.failed, self.done - self.before))

    def watch(self, builds: Iterable[Built]) -> Iterator[Built]:
        """The same builds, each counted as it passes; raises the first error when the first builds all fail."""
        errors: list[BuildError] = []
        for number, built in enumerate(builds, 1):
            if isinstance(built.mesh, BuildError):
                errors.append(built.mesh)
            self.add(1, isinstance(built.mesh, BuildError))
            if number == len(errors) == min(HOPELESS, self.total):
                raise ValueError(f"All of the first {number} builds failed. The first: {errors[0]} {errors[0].hint}")
            yield built


@runtime_checkable
class Executor(Protocol):
    """Where shards are built: `Local`, or `cluster.Ray`."""

    def shards(self, draws: Draws, todo: list[range], counts: Counts) -> Iterator[tuple[range, bytes]]:
        """The numbers and the content of each shard, in the order in which they are ready; counts the builds."""
        ...


@dataclass(frozen=True)
class Local:
    """Builds in processes of this machine."""

    workers: int = 1
    timeout_s: float = 60.0

    def shards(self, draws: Draws, todo: list[range], counts: Counts) -> Iterator[tuple[range, bytes]]:
        with BuildPool(draws.generator, self.workers, self.timeout_s) as pool:
            # All shards are one stream of builds, so that no worker waits for the end of a shard.
            params = chain.from_iterable(draws.params(job) for job in todo)
            built = counts.watch(pool.timed(params, "light"))
            for job in todo:
                yield job, shards.pack_built(draws.generator, draws.seed, job, built)


def build_dataset(
    ref: str,
    folder: str | Path,
    count: int,
    seed: int = 0,
    drawing: Drawing = "uniform",
    executor: Executor = Local(),
    report: Callable[[Progress], None] = lambda progress: None,
) -> int:
    """Sample `count` parameter sets, build and store them; returns the number of failures.

    Shards that are there already stay. Wherever shards are built, they are written here. Raises ValueError when the
    folder holds other data, another process builds in it, `count` is not positive, or nothing can be built; OSError
    when it cannot be written to; and BuildError when no worker can start, which is not the fault of a sample.
    """
    draws, folder = Draws(load_generator(ref), seed, drawing), Path(folder)
    if count < 1:
        raise ValueError(f"The number of samples must be at least 1, got {count}.")
    draws.generator.check_installed()
    with locked(folder, "builds a data set"):
        _claim(folder, draws)
        return _build(draws, folder, count, executor, report)


def _build(draws: Draws, folder: Path, count: int, executor: Executor, report: Callable[[Progress], None]) -> int:
    """Build the shards that are missing; returns the number of failures."""
    jobs = [range(first, min(first + SHARD, count)) for first in range(0, count, SHARD)]
    there = [job for job in jobs if _is_complete(_path(folder, job), len(job))]
    counts = Counts(count, report, sum(map(len, there)), sum(_failures(_path(folder, job)) for job in there))
    for job, content in executor.shards(draws, [job for job in jobs if job not in there], counts):
        write_file(_path(folder, job), content)
    counts.add(0, 0)
    return counts.failed


class Store:
    """Reader of a folder of shards; raises ValueError with a sentence when it is not one."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.info = _read_info(self.folder)
        self.space = load_generator(self.info["ref"]).space
        if self.space.fingerprint != self.info["fingerprint"]:
            raise ValueError(
                f"{self.folder} was built for other parameters of {self.info['generator']!r} than are installed; "
                "build it again with `dipcg dataset build`."
            )

    def table(self, columns: list[str] | None = None) -> pa.Table:
        """All rows as an Arrow table, memory-mapped."""
        return pa.concat_tables([shards.read(path, columns) for path in self._finished()])

    def summary(self) -> dict[str, Any]:
        """Counts, failures by reason with the first of each, sizes, and a histogram of each parameter where active."""
        table = self.table([NUMBER, FAILURE, *self.space.names])
        failures = [shards.parse_failure(text) for text in table[FAILURE].to_pylist() if text]
        reasons = Counter(reason for reason, _ in failures)
        return {
            "generator": self.info["generator"],
            "seed": self.info["seed"],
            "drawing": self.info["drawing"],
            "samples": table.num_rows,
            "failed": dict(sorted(reasons.items())),
            "first_failed": dict(reversed(failures)),
            "splits": {s: sum(in_split(n, s) for n in table[NUMBER].to_pylist()) for s in SPLITS},
            "bytes": sum(path.stat().st_size for path in self._finished()),
            "parameters": {p.name: _histogram(p, _where_active(p.name, self.space, table)) for p in self.space},
        }

    def samples(self, split: str | None = None) -> Iterator[Sample]:
        """The rows of a split (train, validation or test; None for all), meshes decoded; failures have no mesh."""
        for row in self.rows(split):
            yield shards.from_row(row, self.space)

    def rows(self, split: str | None = None) -> Iterator[dict[str, Any]]:
        """The rows of a split as they are stored, shard by shard."""
        for path in self._finished():
            for row in shards.read(path).to_pylist():
                if split is None or in_split(row[NUMBER], split):
                    yield row

    def _finished(self) -> list[Path]:
        paths = sorted(self.folder.glob("shard-*.parquet"))
        if not paths:
            raise ValueError(f"{self.folder} has no finished shard yet; run `dipcg dataset build`.")
        return paths


def in_split(number: int, split: str) -> bool:
    """Whether a sample belongs to the split: by its number, so a data set can grow without moving any."""
    low, high = SPLITS[split]
    return low <= number % 20 < high


def _path(folder: Path, job: range) -> Path:
    return folder / f"shard-{job.start // SHARD:05d}.parquet"


def _is_complete(path: Path, rows: int) -> bool:
    return path.exists() and shards.read(path, [NUMBER]).num_rows >= rows


def _failures(path: Path) -> int:
    return len(shards.read(path, [FAILURE])[FAILURE].drop_null())


def _where_active(name: str, space: ParameterSpace, table: pa.Table) -> pa.Table:
    """The rows in which a parameter is active: `ParameterSpace.is_active` for a whole column."""
    active = np.ones(table.num_rows, bool)
    for choice, allowed in space.conditions(name):
        active &= np.isin(table[choice].to_numpy(), allowed)
    return table.filter(pa.array(active))


def _histogram(parameter: Parameter, table: pa.Table) -> dict[str, int] | list[int]:
    """How often each option occurs, or how many values lie in each of `BINS` equal pieces of the range."""
    if isinstance(parameter, Real):
        values = table[parameter.name].to_numpy()
        return np.histogram(values, BINS, (parameter.low, parameter.high))[0].tolist()
    counts = Counter(table[parameter.name].to_pylist())
    return {str(option): counts[option] for option in parameter.options}


def _read_info(folder: Path) -> dict[str, Any]:
    try:
        info = json.loads((folder / "dataset.json").read_text())
        return {key: info[key] for key in ("generator", "ref", "fingerprint", "seed", "drawing")}
    except (OSError, ValueError, KeyError, TypeError):
        raise ValueError(f"{folder} is not a data set: it has no readable dataset.json.") from None


def _claim(folder: Path, draws: Draws) -> None:
    """Say in the folder which data set it holds, or refuse one that holds another."""
    ours, path = draws.describe(), folder / "dataset.json"
    if not path.exists():
        return write_file(path, json.dumps(ours, indent=1))
    if (theirs := _read_info(folder)) != ours:
        changed = ", ".join(key for key in ours if theirs.get(key) != ours[key])
        raise ValueError(f"{folder} already holds another data set (different {changed}); choose another folder.")
    return None
