"""Generators, their parameters and data sets as text or JSON."""

from __future__ import annotations

import json as jsons
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dipcg import registry
from dipcg.generators import load_generator
from dipcg.model.zoo import shipped
from dipcg.space import Choice, Parameter

if TYPE_CHECKING:
    from dipcg.importing.imported import Imported

BARS = " ▁▂▃▄▅▆▇█"


def generators(json: bool = False) -> str:
    """The installed generators, the number of their parameters, and whether they can be built and estimated here."""
    rows = [_generator(name) for name in registry.names("generators")]
    if json:
        return jsons.dumps(rows, indent=1)
    yes_no = {True: "yes", False: "no"}
    cells = [
        (r["name"], str(r["parameters"]), yes_no[not r["missing"]], yes_no[r["estimates"]], r["doc"]) for r in rows
    ]
    return _aligned([("name", "parameters", "builds here", "estimates", ""), *cells])


def parameters(name: str, json: bool = False) -> str:
    """The parameters of one generator with range or options, unit, condition and meaning."""
    generator = load_generator(name)
    if json:
        return jsons.dumps(generator.space.describe(), indent=1)
    rows = [(p.group, p.name, _range(p), p.unit, _when(p), p.doc) for p in generator.space]
    return generator.doc + "\n\n" + _aligned([("part", "parameter", "range", "unit", "active when", "meaning"), *rows])


def imported(made: Imported) -> str:
    """What `dipcg generators add` wrote: the parameters with values and ranges, what is left out, and what to try."""
    table = _aligned([("parameter", "value", "range", "why"), *made.rows])
    left_out = [f"Left out {name}: {why}." for name, why in made.left_out.items()]
    tried = f"Try: dipcg sample {made.path} -o {made.path.stem}.glb"
    wrote = f"Wrote {made.path}, {len(made.rows)} parameters."
    return "\n".join([table, "", *left_out, *made.notes, wrote, tried])


def data_set(summary: dict[str, Any]) -> str:
    """The summary of a `Store`, with a histogram for each parameter."""
    facts = [(key, str(value)) for key, value in summary.items() if key != "parameters"]
    histograms = [(name, _bars(counts)) for name, counts in summary["parameters"].items()]
    return _aligned(facts) + "\n\n" + _aligned(histograms)


def _bars(counts: dict[str, int] | list[int]) -> str:
    if isinstance(counts, dict):
        return ", ".join(f"{option} {count}" for option, count in counts.items())
    most = max(1, *counts)
    return "".join(BARS[round(count / most * (len(BARS) - 1))] for count in counts)


def _generator(name: str) -> dict[str, Any]:
    generator = load_generator(name)
    return {
        "name": name,
        "parameters": len(generator.space),
        "missing": generator.missing,
        "estimates": name in shipped(),
        "doc": generator.doc.splitlines()[0] if generator.doc else "",
    }


def _range(parameter: Parameter) -> str:
    if isinstance(parameter, Choice):
        return ", ".join(map(str, parameter.options))
    return f"{parameter.low:g} to {parameter.high:g}"


def _when(parameter: Parameter) -> str:
    return "; ".join(f"{name} is {' or '.join(map(str, allowed))}" for name, allowed in parameter.when.items())


def _aligned(rows: Sequence[tuple[str, ...]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)
