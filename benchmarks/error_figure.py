"""The error of every parameter as a figure: reals and choices apart, worst first, beside answers that never look."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.drawing import save_figure
from dipcg.metrics.parameter_error import per_parameter
from dipcg.space import Choice, ParameterSpace, Params, Real

PANELS = {"reals: mean absolute error in x": Real, "choices: share of wrong answers": Choice}


class Error(NamedTuple):
    """Of one parameter: mean absolute error in x, or for a choice the share of wrong answers."""

    name: str
    error: float
    blind: float
    """that of one answer to all pictures: the middle of the range, or the option that is right most often"""
    cases: int
    """in which it is active"""


def parameter_errors(space: ParameterSpace, truths: Sequence[Params], answers: Sequence[Params]) -> list[Error]:
    """The errors of all parameters that are active in some truth, worst first."""
    found: dict[str, list[float]] = {name: [] for name in space.names}
    for truth, answer in zip(truths, answers, strict=True):
        for name, error in per_parameter(space, truth, answer).items():
            found[name].append(error)
    errors = [
        Error(name, float(np.mean(each)), blind(space, name, truths), len(each)) for name, each in found.items() if each
    ]
    return sorted(errors, key=lambda error: -error.error)


def blind(space: ParameterSpace, name: str, truths: Sequence[Params]) -> float:
    """The error of one answer to all pictures: the middle of the range, or the commonest option of a choice."""
    parameter = space[name]
    values = [params[name] for params in truths if space.is_active(name, params)]
    if isinstance(parameter, Choice):
        return 1 - max(values.count(value) for value in set(values)) / len(values)
    return float(np.mean([abs(parameter.encode(value)) for value in values]))


def draw_errors(space: ParameterSpace, errors: Sequence[Error], path: Path) -> None:
    """A bar for each parameter, worst above, and a line across it where the answer that never looks is."""
    from matplotlib.figure import Figure

    parts = {title: [e for e in errors if isinstance(space[e.name], kind)] for title, kind in PANELS.items()}
    shown = {title: part for title, part in parts.items() if part}
    rows = max(map(len, shown.values()))
    figure = Figure((5 * len(shown), 1.2 + 0.19 * rows), layout="constrained")
    panels = figure.subplots(1, len(shown), squeeze=False)[0]
    for axes, (title, part) in zip(panels, shown.items(), strict=True):
        _draw_part(axes, part)
        # Bars have the same thickness in both panels.
        axes.set(title=title, xlim=(0, None), ylim=(rows - 0.5, -0.5))
    panels[-1].legend(loc="lower right")
    save_figure(figure, path, 80)


def _draw_part(axes: Any, errors: Sequence[Error]) -> None:
    places = np.arange(len(errors))
    axes.barh(places, [error.error for error in errors], color="0.6", label="estimate")
    heights = [error.blind for error in errors]
    axes.vlines(heights, places - 0.4, places + 0.4, color="tab:red", label="without looking")
    axes.set_yticks(places, [error.name for error in errors], fontsize=7)
