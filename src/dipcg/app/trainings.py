"""Generators that are learned, each in a folder of its own: what visitors may ask for.

The folder outlives the server.
"""

from __future__ import annotations

import secrets
import shutil
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dipcg import registry
from dipcg.app.jobs import Busy
from dipcg.app.limits import MOST_TRAININGS
from dipcg.app.sources import check_name
from dipcg.app.studio import Studio
from dipcg.app.training_folder import ORDER, WORKING, NoTraining, State, Training, create, free_name
from dipcg.app.training_queue import Queue
from dipcg.importing.editing import edited, read_parameters
from dipcg.importing.program import allow_program
from dipcg.model.zoo import CheckpointError

NO_LEARNING = "This server learns no generators; start it with `dipcg serve --learn FOLDER`."


class Trainings:
    """All that are learned here; `folder` is None where nothing is.

    `blender` is the program of another Blender, for files that are too new for ours.
    """

    def __init__(self, studio: Studio, folder: Path | None, blender: str = "") -> None:
        self._studio, self._folder, self.blender = studio, folder.resolve() if folder else None, blender
        self._queue = Queue(self.all, self._options, self._serve)
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        for training in self.all():
            self._serve(training)
        self._queue.start()

    @property
    def is_open(self) -> bool:
        """Whether generators are learned here."""
        return self._folder is not None

    @property
    def takes_code(self) -> bool:
        """Whether Python files are taken, which run with all rights of the server."""
        return self._folder is not None and registry.is_allowed(self._folder)

    @property
    def changed(self) -> threading.Condition:
        """Whoever holds it sees no training change."""
        return self._queue.changed

    def all(self) -> list[Training]:
        """Every training, the oldest first."""
        if self._folder is None:
            return []
        with self.changed:
            found = [Training(order.parent) for order in self._folder.glob(f"*/{ORDER}")]
            return sorted(found, key=lambda training: training.order["number"])

    def get(self, name: str) -> Training:
        """The training of an id; raises NoTraining."""
        found = next((training for training in self.all() if training.id == name), None)
        if found is None:
            raise NoTraining
        return found

    def state(self, training: Training) -> State:
        """Where a training stands."""
        return self._queue.state(training)

    def start_upload(self, file: str) -> Path:
        """A new folder for a source of this name; raises ValueError with a sentence, and Busy for too many."""
        if self._folder is None:
            raise ValueError(NO_LEARNING)
        check_name(file, self.takes_code)
        if len(self.all()) >= MOST_TRAININGS:
            raise Busy(f"{MOST_TRAININGS} generators are kept here; delete one first.")
        # Its name is its id, and only a folder with an order counts.
        made = self._folder / secrets.token_urlsafe(16)
        made.mkdir()
        return made

    def add(self, folder: Path, file: str, object: str = "", modifier: str = "") -> Training:
        """Have ranges proposed for a source that lies in `folder` as `source`."""
        with self.changed:
            number = 1 + max((training.order["number"] for training in self.all()), default=0)
            training = create(folder, self._free_name(file), number, file, object, modifier)
        self._queue.begin(training, "propose")
        return training

    def edit(self, training: Training, ranges: Mapping[str, Sequence[float]], hold: Sequence[str]) -> None:
        """Take other ranges; what was learned before goes. Raises ValueError with a sentence."""
        self._check_idle(training)
        edited(self._proposed(training), {name: (low, high) for name, (low, high) in ranges.items()}, hold)
        self._studio.forget(training.order["name"])
        self._queue.begin(training, "edit", ranges=dict(ranges), hold=list(hold))

    def learn(self, training: Training, shapes: int, minutes: float) -> None:
        """Start or go on; raises ValueError with a sentence."""
        self._check_idle(training)
        self._proposed(training)
        self._queue.begin(training, "learn", shapes=shapes, minutes=minutes)

    def stop(self, training: Training) -> None:
        """Stop, and keep what is there; it can go on later."""
        self._queue.stop(training)

    def remove(self, training: Training) -> None:
        """Forget the generator with all that was learned."""
        with self.changed:
            self._queue.stop(training)
            if not self._queue.wait_for(training):
                raise ValueError("It is still being stopped; try again in a minute.")
            self._studio.forget(training.order["name"])
            shutil.rmtree(training.folder)

    def close(self) -> None:
        """Stop what runs; it goes on when a server starts in the same folder."""
        if self.is_open:
            self._queue.close()

    def _options(self) -> list[str]:
        """What the process is told besides its folder."""
        return ["--blender", self.blender, *(["--allow-code"] if self.takes_code else [])]

    def _check_idle(self, training: Training) -> None:
        if self.state(training) in WORKING:
            raise ValueError("It is being worked on; stop it first.")

    def _proposed(self, training: Training) -> dict[str, dict[str, Any]]:
        try:
            return read_parameters(training.proposed)
        except OSError:
            raise ValueError("There are no proposed ranges yet.") from None

    def _free_name(self, file: str) -> str:
        others = (training.order["name"] for training in self.all())
        return free_name(file, {*registry.names("generators"), *self._studio.names, *others})

    def _serve(self, training: Training) -> None:
        """Estimate with what was learned, if it is complete."""
        if not training.is_learned:
            return
        try:
            allow_program(training.toml, self.blender)
            self._studio.learn(str(training.checkpoint))
        except (CheckpointError, LookupError, OSError, ValueError) as error:
            training.set_error(str(error))
        else:
            # It may have been served no more by a server without its Blender.
            training.set_error(None)
