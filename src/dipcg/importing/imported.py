"""What every kind of source gives back: the file that was written, and what the command prints about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple


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
