"""Generators that are learned: each in a folder of its own, by a process beside the server, one at a time.

The folder outlives the server, and what was going on when the server ended goes on when it starts again. The process is
`dipcg.cli.learn`. Of the two files through which both talk, the server writes `order.json` and the process
`status.json`.
"""

from __future__ import annotations

import json
import re
import secrets
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from dipcg import registry
from dipcg.app.jobs import Busy
from dipcg.app.limits import MOST_TRAININGS
from dipcg.app.studio import Studio
from dipcg.files import write_file
from dipcg.importing.editing import edited, read_parameters
from dipcg.model.zoo import CARD, CheckpointError

Task = Literal["propose", "edit", "learn"]
State = Literal["waiting", "proposing", "proposed", "learning", "stopping", "stopped", "done", "failed"]
# The states in which something is done, or will be.
WORKING: tuple[State, ...] = ("waiting", "proposing", "learning", "stopping")
ENDINGS = (".blend", ".scad", ".py")
PROGRAM = "dipcg.cli.learn"
# Seconds that a process has to save its state.
LAST_S = 60.0
NO_LEARNING = "This server learns no generators; start it with `dipcg serve --learn FOLDER`."
NO_CODE = (
    "A Python file would run here with all rights of the server, so none is taken. Where only people that you trust "
    "reach the server, start it with `dipcg serve --learn FOLDER --allow-code FOLDER`."
)


class Training:
    """One generator that is learned, as its folder holds it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.id = folder, folder.name

    @property
    def order(self) -> dict[str, Any]:
        """What is wanted: `task`, whether it is `active`, and its settings."""
        return _read(self.folder / "order.json")

    @property
    def status(self) -> dict[str, Any]:
        """What its process has last said."""
        return _read(self.folder / "status.json")

    @property
    def found(self) -> dict[str, Any]:
        """What the source was found to be: values of its parameters, what is left out, and notes."""
        return _read(self.folder / "found.json")

    @property
    def checkpoint(self) -> Path:
        return self.folder / "checkpoint"

    def write(self, **changes: Any) -> None:
        """Change what is wanted."""
        write_file(self.folder / "order.json", json.dumps(self.order | changes))

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


class Trainings:
    """All that are learned here; `folder` is None where nothing is."""

    def __init__(self, studio: Studio, folder: Path | None) -> None:
        self._studio, self._folder = studio, folder.resolve() if folder else None
        self._changed = threading.Condition()
        self._running: str | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        for training in self.all():
            self._serve(training)
        self._thread = threading.Thread(target=self._run, name="trainings", daemon=True)
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """Whether generators are learned here."""
        return self._folder is not None

    @property
    def takes_code(self) -> bool:
        """Whether Python files are taken, which run with all rights of the server."""
        return self._folder is not None and registry.is_allowed(self._folder)

    def all(self) -> list[Training]:
        """Every training, the oldest first."""
        if self._folder is None:
            return []
        found = [Training(order.parent) for order in self._folder.glob("*/order.json")]
        return sorted(found, key=lambda training: training.order["number"])

    def get(self, name: str) -> Training:
        """The training of an id; raises LookupError with a sentence."""
        found = next((training for training in self.all() if training.id == name), None)
        if found is None:
            raise LookupError("There is no such training here.")
        return found

    def state(self, training: Training) -> State:
        """Where a training stands."""
        with self._changed:
            return training.state(self._running == training.id)

    def start_upload(self, file: str) -> Path:
        """A new folder for a source of this name; raises ValueError with a sentence, and Busy for too many."""
        if self._folder is None:
            raise ValueError(NO_LEARNING)
        ending = Path(file).suffix.lower()
        if ending not in ENDINGS:
            raise ValueError(f"Give a Blender file (.blend), an OpenSCAD file (.scad) or a Python file, got {file!r}.")
        if ending == ".py" and not self.takes_code:
            raise ValueError(NO_CODE)
        if len(self.all()) >= MOST_TRAININGS:
            raise Busy(f"{MOST_TRAININGS} generators are kept here; delete one first.")
        # Its name is its id, and only a folder with an order counts.
        made = self._folder / secrets.token_urlsafe(16)
        made.mkdir()
        return made

    def add(self, folder: Path, file: str, object: str = "", modifier: str = "") -> Training:
        """Have ranges proposed for a source that lies in `folder` as `source`."""
        with self._changed:
            name = self._free_name(Path(file).stem)
            stored = f"{name}{Path(file).suffix.lower()}"
            (folder / "source").rename(folder / stored)
            order = {"name": name, "file": stored, "given": file, "object": object, "modifier": modifier}
            number = 1 + max((training.order["number"] for training in self.all()), default=0)
            order |= {"number": number, "ranges": {}, "hold": [], "shapes": 0, "minutes": 0.0}
            write_file(folder / "order.json", json.dumps(order | {"task": "propose", "active": False}))
        training = Training(folder)
        self._begin(training, "propose")
        return training

    def edit(self, training: Training, ranges: Mapping[str, Sequence[float]], hold: Sequence[str]) -> None:
        """Take other ranges; what was learned before goes. Raises ValueError with a sentence."""
        self._check_idle(training)
        edited(self._proposed(training), {name: (low, high) for name, (low, high) in ranges.items()}, hold)
        self._studio.forget(training.order["name"])
        self._begin(training, "edit", ranges=dict(ranges), hold=list(hold))

    def learn(self, training: Training, shapes: int, minutes: float) -> None:
        """Start or go on; raises ValueError with a sentence."""
        self._check_idle(training)
        self._proposed(training)
        self._begin(training, "learn", shapes=shapes, minutes=minutes)

    def stop(self, training: Training) -> None:
        """Stop, and keep what is there; it can go on later."""
        with self._changed:
            training.write(active=False)
            if self._running == training.id and self._process:
                self._process.send_signal(signal.SIGTERM)

    def remove(self, training: Training) -> None:
        """Forget the generator with all that was learned."""
        self.stop(training)
        with self._changed:
            if not self._changed.wait_for(lambda: self._running != training.id, LAST_S):
                raise ValueError("It is still being stopped; try again in a minute.")
            self._studio.forget(training.order["name"])
            shutil.rmtree(training.folder)

    def close(self) -> None:
        """Stop what runs; it goes on when a server starts in the same folder."""
        if self._folder is None:
            return
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            if self._process:
                self._process.send_signal(signal.SIGTERM)
        self._thread.join()

    def _begin(self, training: Training, task: Task, **settings: Any) -> None:
        with self._changed:
            (training.folder / "status.json").unlink(missing_ok=True)
            training.write(task=task, active=True, **settings)
            self._changed.notify_all()

    def _check_idle(self, training: Training) -> None:
        if self.state(training) in WORKING:
            raise ValueError("It is being worked on; stop it first.")

    def _proposed(self, training: Training) -> dict[str, dict[str, Any]]:
        try:
            return read_parameters(training.folder / "proposed.toml")
        except OSError:
            raise ValueError("There are no proposed ranges yet.") from None

    def _free_name(self, stem: str) -> str:
        """A name for the generator that no other has."""
        base = re.sub(r"[^a-z0-9]+", "_", stem.lower()).strip("_")[:40] or "generator"
        base = base if base.isidentifier() else f"generator_{base}"
        taken = {*registry.names("generators"), *self._studio.names, *(one.order["name"] for one in self.all())}
        free = (f"{base}_{number}" if number > 1 else base for number in range(1, len(taken) + 2))
        return next(name for name in free if name not in taken)

    def _run(self) -> None:
        while training := self._next():
            words = [sys.executable, "-m", PROGRAM, str(training.folder)]
            words += ["--allow-code"] if self.takes_code else []
            with (training.folder / "log.txt").open("ab") as log, self._changed:
                # The end of its standard input tells the process that the server is gone.
                self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=log, stderr=log)
                if self._closed or not training.order["active"]:
                    self._process.send_signal(signal.SIGTERM)
            self._await(self._process)
            self._end(training)

    def _next(self) -> Training | None:
        """The first that waits; None when this is closed."""
        with self._changed:
            while True:
                waiting = [training for training in self.all() if training.order["active"]]
                if self._closed or waiting:
                    break
                self._changed.wait()
            if self._closed:
                return None
            self._running = waiting[0].id
            return waiting[0]

    def _await(self, process: subprocess.Popen[bytes]) -> None:
        while process.poll() is None:
            try:
                process.wait(LAST_S)
            except subprocess.TimeoutExpired:
                if self._closed:
                    process.kill()
        if process.stdin:
            process.stdin.close()

    def _end(self, training: Training) -> None:
        self._serve(training)
        with self._changed:
            if not self._closed and training.order["active"]:
                if not training.status.get("finished") and not training.status.get("error"):
                    said = "The process that learns has ended by itself; its messages are in log.txt of its folder."
                    write_file(training.folder / "status.json", json.dumps(training.status | {"error": said}))
                training.write(active=False)
            self._running = self._process = None
            self._changed.notify_all()

    def _serve(self, training: Training) -> None:
        """Estimate with what was learned, if it is complete."""
        if not training.is_learned:
            return
        try:
            self._studio.learn(str(training.checkpoint))
        except (CheckpointError, LookupError, ValueError) as error:
            write_file(training.folder / "status.json", json.dumps(training.status | {"error": str(error)}))


def _read(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text())
    except FileNotFoundError:
        return {}
