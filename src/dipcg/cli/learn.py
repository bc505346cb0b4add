"""What `dipcg serve --learn` runs beside itself for one generator: `python -m dipcg.cli.learn FOLDER`.

The folder's `order.json` says what is wanted: ranges are proposed, edited ranges are tried, or data are built and an
estimator is trained. `status.json` says how far it is. SIGTERM stops it, as the end of its standard input does, which
comes when the server ends in whatever way; the same call goes on from there.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from argparse import ArgumentParser
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dipcg.app.training_folder import ORDER, STATUS
from dipcg.cli.stages import Order, Report, edit, learn, propose
from dipcg.files import locked, write_file
from dipcg.importing.program import allow_program
from dipcg.registry import allow_code

# Seconds between two notes of the progress.
NOTE_S = 1.0
# Others of the machine come first.
NICENESS = 19
TASKS: dict[str, Callable[[Path, Order, Report], None]] = {"propose": propose, "edit": edit, "learn": learn}


def main(folder: Path, blender: str = "") -> None:
    """Do what is wanted in a folder; the status has the sentence of an error."""
    order = json.loads((folder / ORDER).read_text()) | {"blender": blender}
    report = Status(folder)
    try:
        with locked(folder, "works"):
            if order["task"] != "propose":
                allow_program(folder / f"{order['name']}.toml", blender)
            TASKS[order["task"]](folder, order, report)
        report.write(share=1.0, note="", finished=order["task"])
    except KeyboardInterrupt:
        report.write(note="")
    except Exception as error:
        from dipcg.cli.terminal import error_text

        # Visitors see the names that they have given, and not where the files are.
        report.write(note="", error=error_text(error).replace(f"{folder}/", ""))
        raise


class Status:
    """Writes the progress to `status.json`, at most once in a second."""

    def __init__(self, folder: Path) -> None:
        self._path, self._written = folder / STATUS, 0.0
        self._now: dict[str, Any] = {"share": 0.0, "note": "Starting", "finished": "", "error": None}
        self.write()

    def __call__(self, share: float, note: str) -> None:
        if time.monotonic() > self._written + NOTE_S:
            self.write(share=share, note=note)

    def write(self, **changes: Any) -> None:
        """Write at once."""
        self._now |= changes
        write_file(self._path, json.dumps(self._now))
        self._written = time.monotonic()


def _end_with_the_server() -> None:
    # The file object of Python would be locked when the interpreter ends.
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


def run(words: list[str]) -> None:
    """The program: a folder, a Blender for files too new for ours, and whether the Python file in it may run."""
    parser = ArgumentParser("dipcg.cli.learn")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--blender", default="")
    parser.add_argument("--allow-code", action="store_true")
    given = parser.parse_args(words)
    os.nice(NICENESS)
    # A run that is interrupted saves its state.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    threading.Thread(target=_end_with_the_server, daemon=True).start()
    folder = given.folder.resolve()
    if given.allow_code:
        allow_code(folder)
    main(folder, given.blender)


if __name__ == "__main__":
    run(sys.argv[1:])
