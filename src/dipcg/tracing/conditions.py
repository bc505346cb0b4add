"""Under which choices a draw exists, found from the runs in which it was and was not there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Options = tuple[Any, ...]


def condition(
    there: Sequence[bool], choices: Mapping[str, Sequence[Any]], blocked: frozenset[str] = frozenset()
) -> dict[str, Options] | None:
    """The fewest choices and options that hold in exactly the runs where something was there; None if none do.

    `choices` has the option of every choice in each run, None where it was not there. A choice that holds in every such
    run explains the runs that it excludes; the one that explains most comes first.
    """
    found: dict[str, Options] = {}
    unexplained = {run for run, is_there in enumerate(there) if not is_there}
    if len(unexplained) == len(there):
        return None
    allowed = {name: _allowed(there, options) for name, options in choices.items() if name not in blocked}
    excluded = {
        name: {run for run in unexplained if choices[name][run] not in options}
        for name, options in allowed.items()
        if options
    }
    while unexplained:
        best = max(excluded, key=lambda name: len(excluded[name] & unexplained), default=None)
        if best is None or not excluded[best] & unexplained:
            return None
        found[best] = allowed[best]
        unexplained -= excluded[best]
    return found


def _allowed(there: Sequence[bool], options: Sequence[Any]) -> Options:
    """The options under which it was there; none when the choice itself was not always there."""
    here = [option for is_there, option in zip(there, options, strict=True) if is_there]
    return () if None in here else tuple(sorted(set(here), key=str))
