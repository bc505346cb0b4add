"""A parameter space as rows for the page: label, range, value, what is uncertain, what is held."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from dipcg.app.state import Work
from dipcg.space import Choice, Parameter, ParameterSpace, Real, Value

STEPS = 100  # of a slider from end to end, at least
UNSURE_SPREAD = 0.15  # of the range, above which a real parameter is marked
UNSURE_CHANCE = 0.75  # of the chosen option, below which a choice is marked

Row = dict[str, Any]


def rows(space: ParameterSpace, work: Work) -> list[dict[str, Any]]:
    """The parts with their rows, in the order of the space; parts take the place of their first parameter."""
    parts: dict[str, list[Row]] = {}
    for parameter in space if work.params else ():
        parts.setdefault(parameter.group or "parameters", []).append(_row(parameter, space, work))
    return [{"name": name, "rows": found} for name, found in parts.items()]


def _row(parameter: Parameter, space: ParameterSpace, work: Work) -> Row:
    row = {
        "name": parameter.name,
        "label": label(parameter),
        "unit": parameter.unit,
        "doc": parameter.doc,
        "active": space.is_active(parameter.name, work.params),
        "held": parameter.name in work.held,
    }
    return row | (_real(parameter, work) if isinstance(parameter, Real) else _choice(parameter, work))


def label(parameter: Parameter) -> str:
    """The name in words, without the part that is written above it."""
    words = parameter.name.split("_")
    if len(words) > 1 and words[0] == parameter.group:
        words = words[1:]
    return " ".join(words)


def _real(parameter: Real, work: Work) -> Row:
    value, width = float(work.params[parameter.name]), float(parameter.high - parameter.low)
    step = 10.0 ** math.floor(math.log10(width / STEPS))
    spread = 0.0 if parameter.name in work.held else work.spread.get(parameter.name, 0.0)
    ends = [(value + sign * spread - parameter.low) / width for sign in (-1, 1)]
    digits = max(0, -round(math.log10(step)))
    unsure = f"± {spread:.{digits}f}" if spread > UNSURE_SPREAD * width else ""
    return {
        "kind": "real", "low": parameter.low, "high": parameter.high, "step": step, "digits": digits,
        "value": value, "band": [min(max(end, 0.0), 1.0) for end in ends], "unsure": unsure,
    }  # fmt: skip


def _choice(parameter: Choice, work: Work) -> Row:
    value = work.params[parameter.name]
    chance = {} if parameter.name in work.held else work.chances.get(parameter.name, {})
    row = {"value": value, "unsure": _doubt(chance, value)}
    if all(isinstance(option, bool) for option in parameter.options):
        return row | {"kind": "switch"}
    options = [f"{o} ({100 * chance[o]:.0f} %)" if chance else str(o) for o in parameter.options]
    return row | {"kind": "choice", "options": options, "values": parameter.options, "index": parameter.index(value)}


def _doubt(chance: Mapping[Value, float], value: Value) -> str:
    if not chance or chance[value] >= UNSURE_CHANCE:
        return ""
    return f"{100 * chance[value]:.0f} % sure"
