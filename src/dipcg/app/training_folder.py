"""The record of a training on disk: its folder, with what is wanted, how far it is, and what was found.

The server writes `order.json`, and the process that works on the folder writes `status.json` and `found.json`.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Any, Literal

from dipcg.app.uploads import GIVEN, SOURCE
from dipcg.files import write_file
from dipcg.model.zoo import CARD

Task = Literal["propose", "edit", "learn"]
State = Literal["waiting", "proposing", "proposed", "learning", "stopping", "stopped", "done", "failed"]
# The files of its folder: what is wanted, how far it is, what was found, and the ranges before any edit.
ORDER, STATUS, FOUND, PROPOSED = "order.json", "status.json", "found.json", "proposed.toml"
# The states in which something is done, or will be.
WORKING: tuple[State, ...] = ("waiting", "proposing", "learning", "stopping")


class NoTraining(LookupError):
    """A training that is asked for is not there, or no longer."""

    def __init__(self) -> None:
        super().__init__("There is no such training here.")


class Training:
    """One generator that is learned, as its folder holds it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.id = folder, folder.name

    @property
    def order(self) -> dict[str, Any]:
        """What is wanted: `task`, whether it is `active`, and its settings; raises NoTraining once it is removed."""
        if not (order := _read(self.folder / ORDER)):
            raise NoTraining
        return order

    @property
    def status(self) -> dict[str, Any]:
        """What its process has last said; it may end before it says anything."""
        return {"share": 0.0, "note": "", "error": None} | _read(self.folder / STATUS)

    @property
    def found(self) -> dict[str, Any]:
        """What the source was found to be: values of its parameters, what is left out, and notes."""
        return _read(self.folder / FOUND)

    @property
    def data(self) -> Path:
        return self.folder / "data"

    @property
    def checkpoint(self) -> Path:
        return self.folder / "checkpoint"

    @property
    def samples(self) -> Path:
        """The folder of the pictures of random samples."""
        return self.folder / "samples"

    @property
    def proposed(self) -> Path:
        """The file with the ranges that were proposed."""
        return self.folder / PROPOSED

    @property
    def toml(self) -> Path:
        """The file that makes a generator of the source."""
        return self.folder / f"{self.order['name']}.toml"

    def write(self, **changes: Any) -> None:
        """Change what is wanted."""
        write_file(self.folder / ORDER, json.dumps(self.order | changes))

    def set_error(self, sentence: str | None) -> None:
        """Say what went wrong, or that nothing did, beside what its process has said."""
        write_file(self.folder / STATUS, json.dumps(self.status | {"error": sentence}))

    def begin(self, task: Task, **settings: Any) -> None:
        """Want a task done; what was said of the last one goes."""
        (self.folder / STATUS).unlink(missing_ok=True)
        self.write(task=task, active=True, **settings)

    def state(self, running: bool) -> State:
        """Where it stands; `running` says whether its process runs."""
        order, status = self.order, self.status
        if running and not order["active"]:
            return "stopping"
        if order["active"]:
            return ("learning" if order["task"] == "learn" else "proposing") if running else "waiting"
        if status.get("error"):
            return "failed"
        if order["task"] != "learn":
            return "proposed" if status.get("finished") == order["task"] else "stopped"
        return "done" if self.is_learned else "stopped"

    @property
    def is_learned(self) -> bool:
        """Whether the training came to its end."""
        finished = self.order["task"] == self.status.get("finished") == "learn"
        return finished and (self.checkpoint / CARD).is_file()


def create(folder: Path, name: str, number: int, file: str, object: str, modifier: str) -> Training:
    """Make a training of a source that lies in `folder` as `source`; nothing is done for it yet.

    A TOML file beside it says itself which object and modifier it is for.
    """
    if (folder / GIVEN).is_file():
        top = tomllib.loads((folder / GIVEN).read_text(encoding="utf-8"))
        object, modifier = top["object"], top.get("modifier", "")
    stored = f"{name}{Path(file).suffix.lower()}"
    (folder / SOURCE).rename(folder / stored)
    order = {"name": name, "file": stored, "given": file, "object": object, "modifier": modifier, "number": number}
    order |= {"ranges": {}, "hold": [], "shapes": 0, "minutes": 0.0, "task": "propose", "active": False}
    write_file(folder / ORDER, json.dumps(order))
    return Training(folder)


def free_name(file: str, taken: Collection[str]) -> str:
    """A name for the generator of a file that no other has."""
    base = re.sub(r"[^a-z0-9]+", "_", Path(file).stem.lower()).strip("_")[:40] or "generator"
    base = base if base.isidentifier() else f"generator_{base}"
    free = (f"{base}_{number}" if number > 1 else base for number in range(1, len(taken) + 2))
    return next(name for name in free if name not in taken)


def _read(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        return {}
