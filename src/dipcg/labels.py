"""What people read for parameters and their options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dipcg.space import Choice, Parameter, ParameterSpace


def labelled(space: ParameterSpace, labels: Mapping[str, str]) -> ParameterSpace:
    """The space with other labels for some parameters, by their names; raises ValueError for an unknown name."""
    for name in labels:
        space.find(name)
    return ParameterSpace(*(replace(p, label=labels.get(p.name, p.label)) for p in space)) if labels else space


def label(parameter: Parameter) -> str:
    """What people read for a parameter: its label, or its name in words without the part that it belongs to."""
    if parameter.label:
        return parameter.label
    words = [word for word in parameter.name.split("_") if word not in ("is", "has")]
    return " ".join(words[1:] if len(words) > 1 and words[0] == parameter.group else words)


def option_labels(choice: Choice) -> tuple[str, ...]:
    """What people read for the options of a choice."""
    plain = {False: "no", True: "yes"}
    named = (plain[o] if isinstance(o, bool) else str(o).replace("_", " ").replace("-", " ") for o in choice.options)
    return choice.labels or tuple(named)
