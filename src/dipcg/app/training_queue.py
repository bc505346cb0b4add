"""The queue of trainings: a process beside the server works on one at a time, the oldest first.

What was going on when the server ended goes on when it starts again, because `order.json` says so.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence

from dipcg.app.training_folder import State, Task, Training

# The process; the room of the server may not import it.
PROGRAM = "dipcg.cli.learn"
# Seconds that a process has to save its state.
LAST_S = 60.0
ENDED = "The process that learns has ended by itself; its messages are in log.txt of its folder."


class Queue:
    """A thread that runs the process of each training that is active.

    `find` lists all trainings, `options` gives the words for the process besides its folder, and `finish` is called
    with each training whose process has ended.
    """

    def __init__(
        self,
        find: Callable[[], Sequence[Training]],
        options: Callable[[], Sequence[str]],
        finish: Callable[[Training], None],
    ) -> None:
        self._find, self._options, self._finish = find, options, finish
        # Whoever holds it sees no training change.
        self.changed = threading.Condition()
        self._running: str | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="trainings", daemon=True)

    def start(self) -> None:
        """Begin with what is active."""
        self._thread.start()

    def state(self, training: Training) -> State:
        """Where a training stands."""
        with self.changed:
            return training.state(self._running == training.id)

    def begin(self, training: Training, task: Task, **settings: object) -> None:
        """Have a task done when it is the training's turn."""
        with self.changed:
            training.begin(task, **settings)
            self.changed.notify_all()

    def stop(self, training: Training) -> None:
        """Stop, and keep what is there; it can go on later."""
        with self.changed:
            training.write(active=False)
            if self._running == training.id:
                self._interrupt()

    def wait_for(self, training: Training) -> bool:
        """Wait until its process has ended; returns whether it has."""
        with self.changed:
            return self.changed.wait_for(lambda: self._running != training.id, LAST_S)

    def close(self) -> None:
        """Stop what runs, which stays active."""
        with self.changed:
            self._closed = True
            self.changed.notify_all()
            self._interrupt()
        self._thread.join()

    def _interrupt(self) -> None:
        if self._process:
            self._process.send_signal(signal.SIGTERM)

    def _run(self) -> None:
        while training := self._next():
            words = [sys.executable, "-m", PROGRAM, str(training.folder), *self._options()]
            with (training.folder / "log.txt").open("ab") as log, self.changed:
                # The end of its standard input tells the process that the server is gone.
                self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=log, stderr=log)
                if self._closed or not training.order["active"]:
                    self._interrupt()
            self._await(self._process)
            self._end(training)

    def _next(self) -> Training | None:
        """The first that waits; None when this is closed."""
        with self.changed:
            while True:
                waiting = [training for training in self._find() if training.order["active"]]
                if self._closed or waiting:
                    break
                self.changed.wait()
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
        self._finish(training)
        with self.changed:
            if not self._closed and training.order["active"]:
                if not training.status.get("finished") and not training.status.get("error"):
                    training.set_error(ENDED)
                training.write(active=False)
            self._running = self._process = None
            self.changed.notify_all()
