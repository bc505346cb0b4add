"""The command that measures accuracy: evaluate."""

from __future__ import annotations

import json as jsons
from collections.abc import Iterator
from itertools import count as counter
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from dipcg.cli.outputs import check_outputs
from dipcg.files import write_file

if TYPE_CHECKING:
    from dipcg.evaluation.baselines import Shape
    from dipcg.evaluation.evaluate import Case, Plan
    from dipcg.evaluation.tables import Table
    from dipcg.evaluation.topology import Topology
    from dipcg.pipeline import Inverter

# The columns of the paper's table 1.
PAPER_METRICS = ("chamfer", "emd", "fscore")


def evaluate(
    generator: Positional[str],
    /,
    *,
    data: Path | None = None,
    pairs: Path | None = None,
    prefix: str = "",
    protocol: Literal["ours", "paper"] = "ours",
    count: int = 100,
    candidates: int = 16,
    steps: int | None = None,
    metric: tuple[str, ...] = (),
    nearest_of: int = 200,
    rank: bool = False,
    refine: float = 0.0,
    perfect_reader: bool = False,
    meshes: Path | None = None,
    pictures: Path | None = None,
    json: Path | None = None,
) -> None:
    """Measure an estimator on unseen shapes of a data set, or on pictures with surface points.

    With --pictures the pictures are written for another tool, and nothing is measured; with --meshes that tool's meshes
    are measured in place of the estimator's.

    Args:
        generator: a generator's name, or a folder with a checkpoint
        data: folder from `dipcg dataset build`, whose test split is used
        pairs: folder with NAME.png and NAME.npz (array `points`), compared at the best of four quarter turns
        prefix: beginning of the names of the pairs to use; the generator's name when left out
        protocol: ours; or paper, which is that of its table 1: pictures by Cycles with Infinigen's materials from the
            published cameras, no quarter turns, CD, EMD and F. Pictures are kept in the data set's folder
        count: the most shapes to measure
        candidates: number of candidates of each picture, the expected one among them
        steps: steps of the sampler; as many as the checkpoint was made for when left out
        metric: names of metrics, or all; by default CD, F at 0.02 and the share of choices that are right
        nearest_of: number of random shapes, of which the one nearest to the truth is a row: the first of the data set's
            train split, or with --pairs built for it; 0 leaves it out
        rank: build all candidates, and measure the one ranked first and the one nearest to the truth too
        refine: seconds of search after which the result is measured too
        perfect_reader: measure the true parameters too, with those of the estimate wherever they leave the picture as
            it is: what somebody would reach who makes no mistake about what the picture shows; with --data
        meshes: folder with the NAME.glb or NAME.obj that another tool made of each picture
        pictures: folder for the pictures, as NAME.png
        json: file for the table as JSON
    """
    from dipcg.cli.terminal import differences, table
    from dipcg.evaluation.evaluate import Plan
    from dipcg.pipeline import Inverter

    _check_sources(data, pairs, perfect_reader, nearest_of)
    _check_targets(json, pictures, (pairs, meshes), (generator, data, *(pairs or Path()).glob("*.json")))
    metric = metric or (PAPER_METRICS if protocol == "paper" else ())
    if meshes is not None or pictures is not None:
        return _external(
            _cases(protocol, data, pairs, prefix or generator, count), meshes, pictures, count, metric, json
        )
    with Inverter.load(generator, workers=2) as inverter:
        cases = _cases(protocol, data, pairs, prefix or inverter.generator.name, count)
        shapes, turns = _random_shapes(inverter, data, nearest_of), pairs is not None and protocol == "ours"
        plan = Plan(candidates, steps, turns, metric, rank, refine, perfect_reader, shapes)
        measured = _measured(inverter, cases, plan, count)
    print(f"{table(measured)}\n\n{differences(measured)}")
    if json:
        write_file(json, jsons.dumps(measured.to_dict(), indent=1))


def _check_sources(data: Path | None, pairs: Path | None, perfect_reader: bool, nearest_of: int) -> None:
    if (data is None) == (pairs is None):
        raise ValueError("Give one of --data and --pairs.")
    if perfect_reader and data is None:
        raise ValueError("--perfect-reader needs the true parameters and cameras of a data set (--data).")
    if nearest_of < 0:
        raise ValueError(f"--nearest-of is a number of shapes, 0 for none, got {nearest_of}.")


def _check_targets(
    json: Path | None,
    pictures: Path | None,
    folders: tuple[Path | None, ...],
    inputs: tuple[str | Path | None, ...],
) -> None:
    """Raise ValueError when the table or the pictures would replace what is read, before any work is done."""
    from dipcg.export.asset import check_target

    if json is not None:
        check_target(json, (".json",))
    check_outputs((json,), inputs)
    if pictures is not None and any(folder and pictures.resolve() == folder.resolve() for folder in folders):
        raise ValueError(f"{pictures} holds what is read; choose another folder for the pictures.")


def _measured(inverter: Inverter, cases: Iterator[Case], plan: Plan, count: int) -> Table:
    from dipcg.cli.terminal import bar
    from dipcg.evaluation.evaluate import evaluate

    done = counter(1)
    with bar("measuring", count) as update:
        return evaluate(inverter, cases, plan, lambda case: update(next(done), case.name))


def _external(
    cases: Iterator[Case],
    meshes: Path | None,
    pictures: Path | None,
    count: int,
    metric: tuple[str, ...],
    json: Path | None,
) -> None:
    from dipcg.evaluation.external import write_pictures

    if meshes is not None:
        return compare_meshes(cases, meshes, count, list(metric) or None, json)
    assert pictures is not None
    print(f"Wrote {write_pictures(cases, pictures)} pictures to {pictures}; a mesh for each is to have the same name.")


def _random_shapes(inverter: Inverter, data: Path | None, count: int) -> list[Shape]:
    from dipcg.cli.terminal import bar
    from dipcg.evaluation.baselines import built_shapes, stored_shapes

    if data is not None:
        return stored_shapes(data, count)
    with bar("building random shapes", count) as update:
        return built_shapes(inverter.pool, count, report=lambda done: update(done, ""))


def _cases(protocol: str, data: Path | None, pairs: Path | None, prefix: str, count: int) -> Iterator[Case]:
    from dipcg.evaluation.evaluate import pair_cases, split_cases

    if data is not None and protocol == "paper":
        return _as_published(data, count)
    if data is not None:
        return split_cases(data, count)
    assert pairs is not None
    return islice(pair_cases(pairs, prefix), count)


def _as_published(data: Path, count: int) -> Iterator[Case]:
    from dipcg.data.store import Store
    from dipcg.evaluation.photographs import photographed_cases
    from dipcg.training.recipes import published_views

    return photographed_cases(data, count, published_views(Store(data).info["generator"]), data / "paper")


def compare_meshes(
    cases: Iterator[Case], folder: Path, count: int, metrics: list[str] | None, json: Path | None
) -> None:
    """Print the table of a folder's meshes and the table of their topology; with a file write both as JSON."""
    from dipcg.cli.terminal import bar, table
    from dipcg.evaluation.external import measure_meshes

    done = counter(1)
    with bar("measuring", count) as update:
        measured, shapes, quads = measure_meshes(cases, folder, metrics, lambda case: update(next(done), case.name))
    print(table(measured) + "\n\n" + topology_table(shapes, quads))
    if json:
        about = {name: vars(shape) | {"quads": quads.get(name)} for name, shape in shapes.items()}
        write_file(json, jsons.dumps({"accuracy": measured.to_dict(), "topology": about}, indent=1))


def topology_table(shapes: dict[str, Topology], quads: dict[str, float]) -> str:
    """Medians over the meshes as a Markdown table; the share of quads only for files that can have any."""
    import numpy as np

    values = list(shapes.values())
    cells = [
        str(len(values)),
        f"{np.median([shape.triangles for shape in values]):,.0f}",
        f"{np.mean([shape.watertight for shape in values]):.0%}",
        f"{np.median([shape.open_edges for shape in values]):,.0f}",
        f"{np.median([shape.non_manifold_edges for shape in values]):,.0f}",
        f"{np.mean(list(quads.values())):.0%}" if quads else "",
    ]
    head = ["meshes", "triangles (median)", "watertight", "open edges (median)", "non-manifold edges (median)", "quads"]
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), cells))
