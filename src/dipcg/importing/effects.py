"""What was seen of the parameters of a generator: which change the mesh, and under which options."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from dipcg.importing.starts import is_inside, options_of
from dipcg.space import ParameterSpace, Params, Value

# An option counts as one without effect after so many tries.
TRIES = 3
UNTRIED = "no time was left to try it, or no build with it worked; give more --seconds"

# The options of choices by parameter, as in `when`.
Conditions = dict[str, dict[str, Any]]


@dataclass
class Effects:
    """What was seen: for each parameter how far it moved the surface at most, as a share of the side, and more."""

    sizes: dict[str, float] = field(default_factory=dict)
    moved_from: dict[str, list[Params]] = field(default_factory=lambda: defaultdict(list))
    """For each parameter the starts from which it moved the surface"""
    quiet: dict[tuple[str, str, Value], int] = field(default_factory=lambda: defaultdict(int))
    """For a parameter, a choice and an option: how often the parameter stopped mattering when only that was changed"""
    failed: list[str] = field(default_factory=list)
    """Sentences of builds that failed"""
    builds: int = 0
    is_cut_short: bool = False
    """Whether the time ended before everything was tried"""

    def without(self, space: ParameterSpace) -> list[str]:
        """The parameters that changed nothing."""
        return [name for name in space.names if not self.sizes.get(name)]

    def matters_under(self, space: ParameterSpace, name: str, choice: str, option: Value) -> bool:
        """Whether a parameter was seen to matter under an option, or without the choice."""
        return any(not space.is_active(choice, one) or one[choice] == option for one in self.moved_from[name])

    def within(self, space: ParameterSpace) -> Effects:
        """What was seen of the parameters of a smaller space, from starts that lie in it."""
        kept = Effects({name: size for name, size in self.sizes.items() if name in space})
        for name in kept.sizes:
            if starts := [space.canonical(one) for one in self.moved_from[name] if is_inside(space, one)]:
                kept.moved_from[name] = starts
        return kept

    def notes(self) -> list[str]:
        """Sentences about the builds for those who wait for them."""
        found = [f"{len(self.failed)} of {self.builds} builds failed: {one}" for one in self.failed[:1]]
        return found + ["Time ended before everything was tried; --seconds gives more."] * self.is_cut_short


def conditions(space: ParameterSpace, names: Sequence[str], effects: Effects) -> Conditions:
    """`when` of each of the names: what the space declares, and the options under which there was an effect.

    Conditions that would lead back to the parameter that has them are left out.
    """
    found: Conditions = {name: dict(space[name].when) for name in names}
    without = [key for key, times in effects.quiet.items() if times >= TRIES and not effects.matters_under(space, *key)]
    for name, choice, option in without:
        if name in names and choice in names and name not in _above(choice, found):
            options = tuple(o for o in found[name].get(choice, options_of(space, choice)) if o != option)
            found[name] |= {choice: options} if options else {}
    return {name: {choice: list(options) for choice, options in when.items()} for name, when in found.items()}


def _above(name: str, found: Conditions) -> set[str]:
    """A parameter, and all choices that it depends on."""
    return {name}.union(*(_above(choice, found) for choice in found.get(name, ())))
