"""What `dipcg evaluate` does with meshes that other tools made: their accuracy, and beside it their topology."""

from __future__ import annotations

import json as jsons
from collections.abc import Iterator
from itertools import count as counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from dipcg.evaluation.evaluate import Case
    from dipcg.evaluation.topology import Topology


def compare_meshes(
    cases: Iterator[Case], folder: Path, count: int, metrics: list[str] | None, json: Path | None
) -> None:
    """Print the table of a folder's meshes and the table of their topology; write both as JSON when asked to."""
    from dipcg.evaluation.external import measure_meshes
    from dipcg.cli.terminal import bar, table

    done = counter(1)
    with bar("measuring", count) as update:
        found, shapes, quads = measure_meshes(cases, folder, metrics, lambda case: update(next(done), case.name))
    print(table(found) + "\n\n" + topology_table(shapes, quads))
    if json:
        about = {name: vars(shape) | {"quads": quads.get(name)} for name, shape in shapes.items()}
        json.write_text(jsons.dumps({"accuracy": found.to_dict(), "topology": about}, indent=1))


def topology_table(shapes: dict[str, Topology], quads: dict[str, float]) -> str:
    """Medians over the meshes as a Markdown table; the share of quads only for files that can have any."""
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
