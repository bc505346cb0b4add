"""What every kind of source gives back: the file that was written, and what the command prints about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

# Names that are listed for each reason to leave something out.
NAMES_SHOWN = 12


class Row(NamedTuple):
    """A parameter in the printed table: its name, its value in the source, its range or options, and why these."""

    name: str
    value: str
    range: str
    why: str


@dataclass(frozen=True)
class Imported:
    """The TOML file, its parameters, the inputs that are left out and why, and sentences about the source."""

    path: Path
    rows: list[Row]
    left_out: dict[str, str]
    notes: list[str] = field(default_factory=list)

    @property
    def parameters(self) -> list[str]:
        """The names of the parameters."""
        return [row.name for row in self.rows]


def grouped(left_out: Mapping[str, str]) -> dict[str, str]:
    """What is left out by the reason why, with a few names for each."""
    by_reason: dict[str, list[str]] = {}
    for name, why in left_out.items():
        by_reason.setdefault(why, []).append(name)
    return {_few(names): why for why, names in by_reason.items()}


def _few(names: Sequence[str]) -> str:
    more = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")


def listed(left_out: Mapping[str, str], nothing: str = "") -> str:
    """What is left out and why, in one sentence."""
    return "; ".join(f"{names}: {why}" for names, why in grouped(left_out).items()) or nothing
