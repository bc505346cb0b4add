"""Samples on disk: parameters as Parquet columns, the light mesh as one compact column, in resumable shards.

A shard is written whole and renamed into place, and sample `i` depends on the seed and `i` alone, so a build that was
killed anywhere goes on with the same rows.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dipcg.codec import decode_mesh, encode_mesh
from dipcg.generators import Generator, load_generator
from dipcg.mesh import Mesh
from dipcg.space import Choice, ParameterSpace, Params
from dipcg.worker import BuildError, BuildPool

SHARD = 250
PREFIX = "param."
SPLITS = {"train": (0, 18), "validation": (18, 19), "test": (19, 20)}  # twentieths, by sample number


@dataclass(frozen=True)
class Sample:
    """One row: the parameters, the mesh unless the build failed, and why it failed."""

    number: int
    params: Params
    mesh: Mesh | None
    build_s: float
    failure: str | None
    """a worker.BuildError's reason"""
    sentence: str = ""
    """what it said, with the parameters"""


@dataclass(frozen=True)
class Progress:
    """Where a build stands, for a progress bar."""

    done: int
    total: int
    failed: int


def build_dataset(
    ref: str,
    folder: str | Path,
    count: int,
    seed: int = 0,
    workers: int = 1,
    timeout_s: float = 60.0,
    report: Callable[[Progress], None] = lambda progress: None,
) -> int:
    """Sample `count` parameter sets, build and store them; shards already there are kept. Returns the failures.

    Raises ValueError when the folder holds other data, or `count` is not positive, and BuildError when no worker can
    start: that is the fault of no sample.
    """
    generator, folder = load_generator(ref), Path(folder)
    generator.check_installed()
    if count < 1:
        raise ValueError(f"The number of samples must be at least 1, got {count}.")
    _claim(folder, generator, seed)
    failed, done = 0, 0
    with BuildPool(ref, workers, timeout_s) as pool:
        for first in range(0, count, SHARD):
            numbers = range(first, min(first + SHARD, count))
            path = folder / f"shard-{first // SHARD:05d}.parquet"
            if not _is_complete(path, len(numbers)):
                _write(path, _build_shard(pool, generator, seed, numbers), generator)
            failed += _failures(path)
            done += len(numbers)
            report(Progress(done, count, failed))
    return failed


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

    @property
    def shards(self) -> list[Path]:
        return sorted(self.folder.glob("shard-*.parquet"))

    def table(self, columns: list[str] | None = None) -> pa.Table:
        """All rows as an Arrow table, memory-mapped."""
        if not self.shards:
            raise ValueError(f"{self.folder} has no finished shard yet; run `dipcg dataset build`.")
        return pa.concat_tables([_read_shard(path, columns) for path in self.shards])

    def summary(self) -> dict[str, Any]:
        """Counts, failures by reason with the first of each, and sizes."""
        table = self.table(["number", "failure"])
        failures = [_parse_failure(told) for told in table["failure"].to_pylist() if told]
        reasons = [reason for reason, _ in failures]
        return {
            "generator": self.info["generator"],
            "seed": self.info["seed"],
            "samples": table.num_rows,
            "failed": {reason: reasons.count(reason) for reason in sorted(set(reasons))},
            "first_failed": dict(reversed(failures)),
            "splits": {s: sum(in_split(n, s) for n in table["number"].to_pylist()) for s in SPLITS},
            "bytes": sum(path.stat().st_size for path in self.shards),
        }

    def samples(self, split: str | None = None) -> Iterator[Sample]:
        """The rows of a split (train, validation or test; None for all), meshes decoded; failures have no mesh."""
        for row in self.table().to_pylist():
            if split is None or in_split(row["number"], split):
                yield _from_row(row, self.space)


def in_split(number: int, split: str) -> bool:
    """Whether a sample belongs to the split: by its number, so a data set can grow without moving any."""
    low, high = SPLITS[split]
    return low <= number % 20 < high


def sample_params(space: ParameterSpace, seed: int, number: int) -> Params:
    """The parameters of one sample: a function of the seed and its number alone."""
    return space.sample(np.random.default_rng([seed, number]))


def _build_shard(pool: BuildPool, generator: Generator, seed: int, numbers: range) -> list[Sample]:
    many = [sample_params(generator.space, seed, number) for number in numbers]
    started = [time.perf_counter()]
    samples = []
    for number, params, built in zip(numbers, many, pool.map(many, "light"), strict=True):
        started.append(time.perf_counter())
        seconds = started[-1] - started[-2]
        samples.append(_sample(number, params, built, seconds))
    return samples


def _sample(number: int, params: Params, built: Mesh | BuildError, seconds: float) -> Sample:
    if not isinstance(built, BuildError):
        return Sample(number, params, built, seconds, None)
    if built.reason == "start":
        raise built
    return Sample(number, params, None, seconds, built.reason, str(built))


def _write(path: Path, samples: list[Sample], generator: Generator) -> None:
    unfinished = path.with_suffix(f".{os.getpid()}.tmp")
    pq.write_table(
        pa.Table.from_pylist([_to_row(s) for s in samples], _schema(generator)), unfinished, compression="zstd"
    )
    unfinished.replace(path)


def _schema(generator: Generator) -> pa.Schema:
    columns = [pa.field(PREFIX + p.name, _arrow_type(p)) for p in generator.space]
    about = [("number", pa.int64()), ("mesh", pa.binary()), ("build_s", pa.float32()), ("failure", pa.string())]
    return pa.schema([*columns, *about], metadata={"dipcg": json.dumps(_info(generator, None))})


def _arrow_type(parameter: Any) -> pa.DataType:
    value = parameter.options[0] if isinstance(parameter, Choice) else 0.0
    return {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}[type(value)]


def _to_row(sample: Sample) -> dict[str, Any]:
    mesh = encode_mesh(sample.mesh) if sample.mesh else None
    failure = f"{sample.failure}: {sample.sentence}" if sample.failure else None
    about = {"number": sample.number, "mesh": mesh, "build_s": sample.build_s, "failure": failure}
    return {PREFIX + name: value for name, value in sample.params.items()} | about


def _from_row(row: dict[str, Any], space: ParameterSpace) -> Sample:
    params = {name: row[PREFIX + name] for name in space.names}
    mesh = decode_mesh(row["mesh"]) if row["mesh"] else None
    reason, sentence = _parse_failure(row["failure"] or "")
    return Sample(row["number"], params, mesh, row["build_s"], reason or None, sentence)


def _parse_failure(told: str) -> tuple[str, str]:
    """The reason of a failure and its sentence, which older data sets do not have."""
    reason, _, sentence = told.partition(": ")
    return reason, sentence


def _read_shard(path: Path, columns: list[str] | None = None) -> pa.Table:
    try:
        return pq.read_table(path, columns=columns, memory_map=True)
    except (pa.ArrowInvalid, OSError) as error:
        raise ValueError(f"{path} is damaged ({error}); delete it and run `dipcg dataset build` again.") from None


def _is_complete(path: Path, rows: int) -> bool:
    return path.exists() and _read_shard(path, ["number"]).num_rows >= rows


def _failures(path: Path) -> int:
    return len(_read_shard(path, ["failure"])["failure"].drop_null())


def _info(generator: Generator, seed: int | None) -> dict[str, Any]:
    info = {"generator": generator.name, "ref": generator.ref, "fingerprint": generator.space.fingerprint}
    return info if seed is None else info | {"seed": seed}


def _read_info(folder: Path) -> dict[str, Any]:
    try:
        info = json.loads((folder / "dataset.json").read_text())
        return {key: info[key] for key in ("generator", "ref", "fingerprint", "seed")}
    except (OSError, ValueError, KeyError, TypeError):
        raise ValueError(f"{folder} is not a data set: it has no readable dataset.json.") from None


def _claim(folder: Path, generator: Generator, seed: int) -> None:
    """Make the folder this data set's own, or refuse one that is another's."""
    folder.mkdir(parents=True, exist_ok=True)
    path, ours = folder / "dataset.json", _info(generator, seed)
    if path.exists() and (theirs := _read_info(folder)) != ours:
        changed = ", ".join(key for key in ours if theirs.get(key) != ours[key])
        raise ValueError(f"{folder} already holds another data set (different {changed}); choose another folder.")
    unfinished = path.with_suffix(f".{os.getpid()}.tmp")
    unfinished.write_text(json.dumps(ours, indent=1))
    unfinished.replace(path)
