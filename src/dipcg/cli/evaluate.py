"""Commands that make estimators: dataset build, info and gallery, train, evaluate."""

from __future__ import annotations

import json as jsons
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count as counter
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from dipcg.cli.assets import Output
from dipcg.config import ModelConfig, TrainConfig
from dipcg.model.zoo import RUNS

if TYPE_CHECKING:
    from dipcg.evaluation.baselines import Shape
    from dipcg.evaluation.evaluate import Case
    from dipcg.pipeline import Inverter
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
    """Sample a generator and store parameters and light meshes; a killed build goes on where it was.

    Args:
        generator: name, or a path to a Python or TOML file
        output: folder for the shards
        count: number of shapes
        seed: of the shapes
        workers: processes that build
        timeout_s: seconds after which a build is given up
        drawing: of parameters, each by itself, or sobol: spread more evenly, for few samples
        executor: this machine, or ray: a Ray cluster with as many workers as it has processors
        address: of the Ray cluster, as `ray start` prints it; one on this machine when left out
        resume: go on with a folder that already has shards
    """
    from dipcg.data.cluster import Ray
    from dipcg.data.store import Local, build_dataset
    from dipcg.cli.terminal import bar

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
    """Say what a data set holds.

    Args:
        folder: with shards
        json: print JSON
    """
    from dipcg.cli.listing import data_set
    from dipcg.data.store import Store

    found = Store(folder).summary()
    print(jsons.dumps(found, indent=1) if json else data_set(found))


def dataset_gallery(folder: Positional[Path], /, *, output: Output, count: int = 48) -> None:
    """Draw a contact sheet of a data set.

    Args:
        folder: with shards
        output: PNG file
        count: number of shapes
    """
    from dipcg.export.asset import check_target
    from dipcg.inference.preview import contact_sheet
    from dipcg.data.store import Store

    check_target(output, (".png",))
    meshes = [sample.mesh for sample in islice(Store(folder).samples(), count) if sample.mesh]
    if not meshes:
        raise ValueError(f"None of the first {count} samples in {folder} has a mesh to draw.")
    contact_sheet(meshes, output)
    print(f"Wrote {output}.")


def train(
    generator: Positional[str],
    /,
    *,
    data: Path,
    output: Output = RUNS,
    recipe: str = "ours",
    train: Annotated[TrainConfig, arg(name="")] = TrainConfig(),  # noqa: B008 - frozen
    model: Annotated[ModelConfig, arg(name="")] = ModelConfig(),  # noqa: B008 - frozen
) -> None:
    """Train an estimator on a data set; a killed run goes on where it was.

    Args:
        generator: name, or a path to a Python or TOML file; its checkpoint goes to a folder of this name in the output
        data: folder from `dipcg dataset build`
        output: folder for checkpoints
        recipe: ours, paper, single-view, clip, small or large; what the flags below default to
    """
    from dipcg.generators import load_generator
    from dipcg.training.recipes import find_recipe
    from dipcg.data.store import Store
    from dipcg.cli.terminal import bar
    from dipcg.training.log import Log
    from dipcg.training.train import train as run

    find_recipe(recipe)
    info = Store(data).info
    if generator != info["generator"] and load_generator(generator).ref != info["ref"]:
        raise ValueError(f"{data} holds shapes of {info['generator']!r}, not of {generator!r}.")
    folder = output / info["generator"]
    with bar("training", 1000) as update, Log(folder, data) as log:

        def report(status: Any) -> None:
            update(int(1000 * status.share), f"loss {status.loss:.3f}, {status.pictures_per_s:.0f} pictures/s")
            log(status)

        run(data, folder, train, model, report)
    print(f"Wrote the best weights to {folder}. Try: dipcg estimate PICTURE -g {folder} -o out.glb")


def evaluate(
    generator: Positional[str],
    /,
    *,
    data: Path | None = None,
    pairs: Path | None = None,
    prefix: str = "",
    count: int = 100,
    candidates: int = 16,
    steps: int | None = None,
    metric: tuple[str, ...] = (),
    nearest_of: int = 200,
    rank: bool = False,
    refine: float = 0.0,
    meshes: Path | None = None,
    pictures: Path | None = None,
    json: Path | None = None,
) -> None:
    """Measure an estimator on unseen shapes of a data set, or on pictures with surface points.

    With --pictures the pictures are written for another tool, and nothing is measured; with --meshes that tool's meshes
    are measured in place of the estimator's.

    Args:
        generator: name, or a folder with a checkpoint
        data: folder from `dipcg dataset build`, of which the test split is used
        pairs: folder with NAME.png and NAME.npz (array `points`), compared at the best of four quarter turns
        prefix: only pairs whose names start so; the generator's name when left out
        count: at most so many shapes
        candidates: how many of each picture, the expected one among them
        steps: of the sampler; as many as the checkpoint was made for when left out
        metric: names of metrics; all when left out
        nearest_of: random shapes, of which the one nearest to the truth is a row: the first of the data set's train
            split, or with --pairs built for it; 0 leaves it out
        rank: build all candidates, and measure the one ranked first and the one nearest to the truth too
        refine: measure what so many seconds of search make of it too
        meshes: folder with the NAME.glb or NAME.obj that another tool made of each picture
        pictures: folder for the pictures, as NAME.png
        json: file for the table as JSON
    """
    from dipcg.evaluation.evaluate import Plan
    from dipcg.evaluation.evaluate import evaluate as measure
    from dipcg.export.asset import check_target
    from dipcg.pipeline import Inverter
    from dipcg.cli.terminal import bar, differences, table

    if (data is None) == (pairs is None):
        raise ValueError("Give one of --data and --pairs.")
    if nearest_of < 0:
        raise ValueError(f"--nearest-of is a number of shapes, 0 for none, got {nearest_of}.")
    if json is not None:
        check_target(json, (".json",))
    if meshes is not None or pictures is not None:
        return _foreign(_cases(data, pairs, prefix or generator, count), meshes, pictures, count, metric, json)
    with Inverter.load(generator, workers=2) as inverter:
        cases, done = _cases(data, pairs, prefix or inverter.generator.name, count), counter(1)
        shapes = _random_shapes(inverter, data, nearest_of)
        plan = Plan(candidates, steps, pairs is not None, metric, rank, refine, shapes)
        with bar("measuring", count) as update:
            found = measure(inverter, cases, plan, lambda case: update(next(done), case.name))
    print(f"{table(found)}\n\n{differences(found)}")
    if json:
        json.write_text(jsons.dumps(found.to_dict(), indent=1))


def _foreign(
    cases: Iterator[Case],
    meshes: Path | None,
    pictures: Path | None,
    count: int,
    metric: tuple[str, ...],
    json: Path | None,
) -> None:
    from dipcg.cli.meshes import compare_meshes
    from dipcg.evaluation.external import write_pictures

    if meshes is not None:
        return compare_meshes(cases, meshes, count, list(metric) or None, json)
    assert pictures is not None
    print(f"Wrote {write_pictures(cases, pictures)} pictures to {pictures}; a mesh for each is to have the same name.")


def _random_shapes(inverter: Inverter, data: Path | None, count: int) -> list[Shape]:
    from dipcg.evaluation.baselines import built_shapes, stored_shapes
    from dipcg.cli.terminal import bar

    if data is not None:
        return stored_shapes(data, count)
    with bar("building random shapes", count) as update:
        return built_shapes(inverter.pool, count, report=lambda done: update(done, ""))


def _cases(data: Path | None, pairs: Path | None, prefix: str, count: int) -> Iterator[Case]:
    from dipcg.evaluation.evaluate import pair_cases, split_cases

    if data is not None:
        return split_cases(data, count)
    assert pairs is not None
    return islice(pair_cases(pairs, prefix), count)
