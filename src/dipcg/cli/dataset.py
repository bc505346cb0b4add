"""The commands about data sets: dataset build, dataset info, dataset gallery."""

from __future__ import annotations

import json as jsons
import time
from collections.abc import Callable
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from dipcg.cli.assets import Output
from dipcg.cli.outputs import check_outputs

if TYPE_CHECKING:
    from dipcg.data.store import Progress


def dataset_build(
    generator: Positional[str],
    /,
    *,
    output: Output,
    count: int = 20_000,
    seed: int = 0,
    workers: int = 2,
    timeout_s: float = 60.0,
    drawing: Literal["uniform", "sobol"] = "uniform",
    executor: Literal["local", "ray"] = "local",
    address: str | None = None,
    resume: bool = True,
) -> None:
    """Sample a generator and store parameters and light meshes; a killed build continues where it stopped.

    Args:
        generator: a generator's name, or the path of a Python or TOML file
        output: folder for the shards
        count: number of shapes
        seed: random seed of the shapes
        workers: number of processes that build
        timeout_s: seconds after which a build is stopped
        drawing: how parameters are drawn: uniform, each by itself, or sobol, spread more evenly, for few samples
        executor: local for this machine, or ray for a Ray cluster with as many workers as it has processors
        address: address of the Ray cluster, as `ray start` prints it; one on this machine when left out
        resume: continue in a folder that already has shards
    """
    from dipcg.cli.terminal import bar
    from dipcg.data.cluster import Ray
    from dipcg.data.store import Local, build_dataset

    if not resume and any(output.glob("shard-*.parquet")):
        raise ValueError(f"{output} already has shards; choose another folder, or leave out --no-resume.")
    where = Local(workers, timeout_s) if executor == "local" else Ray(address, timeout_s)
    with bar("building", count) as update:
        report = partial(_report, update, time.perf_counter())
        failed = build_dataset(generator, output, count, seed, drawing, where, report)
    why = f" `dipcg dataset info {output}` says why." if failed else ""
    print(f"{count - failed} shapes in {output}, {failed} failed.{why}")


def _report(update: Callable[[int, str], None], started: float, progress: Progress) -> None:
    rate = progress.new / max(time.perf_counter() - started, 1e-6)
    update(progress.done, f"{rate:.1f}/s, {progress.failed} failed")


def dataset_info(folder: Positional[Path], /, *, json: bool = False) -> None:
    """Print the contents of a data set: counts, failures, and a histogram of each parameter.

    Args:
        folder: folder with shards
        json: print JSON
    """
    from dipcg.cli.listing import data_set
    from dipcg.data.store import Store

    summary = Store(folder).summary()
    print(jsons.dumps(summary, indent=1) if json else data_set(summary))


def dataset_gallery(folder: Positional[Path], /, *, output: Output, count: int = 48) -> None:
    """Draw a contact sheet of a data set.

    Args:
        folder: folder with shards
        output: PNG file
        count: number of shapes
    """
    from dipcg.data.store import Store
    from dipcg.export.asset import check_target
    from dipcg.inference.preview import contact_sheet

    check_target(output, (".png",))
    check_outputs((output,), (folder,))
    meshes = [sample.mesh for sample in islice(Store(folder).samples(), count) if sample.mesh]
    if not meshes:
        raise ValueError(f"None of the first {count} samples in {folder} has a mesh to draw.")
    contact_sheet(meshes, output)
    print(f"Wrote {output}.")
