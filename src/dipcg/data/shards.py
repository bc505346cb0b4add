"""The format of a shard: a Parquet file with the parameters as columns and the light mesh as one compact column.

Columns of parameters have the parameters' own names; what else a row holds begins with an underscore, which no
parameter's name does.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from dipcg.data.codec import decode_mesh, encode_mesh
from dipcg.generators import Generator
from dipcg.mesh import Mesh
from dipcg.space import Choice, Parameter, ParameterSpace, Params
from dipcg.workers.pool import Built
from dipcg.workers.process import BuildError

NUMBER, SEED, MESH, BUILD_S, FAILURE = "_number", "_seed", "_mesh", "_build_s", "_failure"
_ABOUT = (
    (NUMBER, pa.int64()),
    (SEED, pa.int64()),
    (MESH, pa.binary()),
    (BUILD_S, pa.float32()),
    (FAILURE, pa.string()),
)


@dataclass(frozen=True)
class Sample:
    """One row: the parameters, the mesh unless the build failed, and why it failed."""

    number: int
    seed: int
    params: Params
    mesh: Mesh | None
    build_s: float | None
    """seconds that a worker took; None when the build failed"""
    failure: str | None = None
    """the reason of a `BuildError`"""
    sentence: str = ""
    """its message, and how to build the same again"""


def pack_built(generator: Generator, seed: int, job: range, built: Iterable[Built]) -> bytes:
    """The content of a shard: the next builds under the numbers of a job.

    `built` may go on with the next shard. Raises BuildError when the workers could not start.
    """
    return pack([_sample(number, seed, one) for number, one in zip(job, built, strict=False)], generator)


def pack(samples: Sequence[Sample], generator: Generator) -> bytes:
    """The samples as the content of a Parquet file."""
    written = io.BytesIO()
    table = pa.Table.from_pylist([_to_row(sample) for sample in samples], _schema(generator))
    pq.write_table(table, written, compression="zstd")
    return written.getvalue()


def read(path: Path, columns: list[str] | None = None) -> pa.Table:
    """The rows of a shard, memory-mapped; raises ValueError for a damaged one."""
    try:
        return pq.read_table(path, columns=columns, memory_map=True)
    except (pa.ArrowInvalid, OSError) as error:
        raise ValueError(f"{path} is damaged ({error}); delete it and run `dipcg dataset build` again.") from None


def from_row(row: dict[str, Any], space: ParameterSpace) -> Sample:
    """A row of a shard as a sample with its mesh decoded."""
    params = {name: row[name] for name in space.names}
    mesh = decode_mesh(row[MESH]) if row[MESH] else None
    reason, sentence = parse_failure(row[FAILURE] or "")
    return Sample(row[NUMBER], row[SEED], params, mesh, row[BUILD_S], reason or None, sentence)


def parse_failure(text: str) -> tuple[str, str]:
    """The reason of a failure and its sentence."""
    reason, _, sentence = text.partition(": ")
    return reason, sentence


def versions(generator: Generator) -> dict[str, str]:
    """The versions of this package and of those that the generator needs, as far as they are installed."""
    installed = {}
    for package in ("dipcg", *generator.needs):
        with suppress(PackageNotFoundError):
            installed[package] = version(package)
    return installed


def _sample(number: int, seed: int, built: Built) -> Sample:
    if not isinstance(built.mesh, BuildError):
        return Sample(number, seed, built.params, built.mesh, built.seconds)
    error = built.mesh
    if error.reason == "start":
        raise error
    return Sample(number, seed, built.params, None, None, error.reason, f"{error} {error.hint}")


def _schema(generator: Generator) -> pa.Schema:
    columns = [pa.field(p.name, _arrow_type(p)) for p in generator.space]
    about = {
        "generator": generator.name,
        "fingerprint": generator.space.fingerprint,
        "versions": versions(generator),
        "space": generator.space.describe(),
    }
    return pa.schema([*columns, *_ABOUT], metadata={"dipcg": json.dumps(about)})


def _arrow_type(parameter: Parameter) -> pa.DataType:
    value = parameter.options[0] if isinstance(parameter, Choice) else 0.0
    return {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}[type(value)]


def _to_row(sample: Sample) -> dict[str, Any]:
    mesh = encode_mesh(sample.mesh) if sample.mesh else None
    failure = f"{sample.failure}: {sample.sentence}" if sample.failure else None
    return sample.params | dict(
        zip(
            (NUMBER, SEED, MESH, BUILD_S, FAILURE),
            (sample.number, sample.seed, mesh, sample.build_s, failure),
            strict=True,
        )
    )
