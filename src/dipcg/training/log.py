"""A log of training: one line of JSON per validation, and TensorBoard's files when it is installed."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

from dipcg.training.snapshots import Snapshots
from dipcg.training.train import Status


class Log:
    """Writes to `log.jsonl` and, with tensorboard installed, to event files in the same folder.

    With a data set, these show what the checkpoint in the folder makes of a few validation shapes.
    """

    def __init__(self, folder: Path, data: Path | None = None) -> None:
        self._data = data
        self._snapshots: Snapshots | None = None
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._lines = (folder / "log.jsonl").open("a")

    @cached_property
    def _board(self) -> Any:  # made when there is something to say: of several processes, one reports
        return _board(self._folder)

    def __call__(self, status: Status) -> None:
        if self._board:
            self._board.add_scalar("loss", status.loss, status.pictures)
            self._board.add_scalar("waiting for pictures", status.waiting, status.pictures)
        if status.validation:
            self._lines.write(json.dumps(asdict(status)) + "\n")
            self._lines.flush()
            for name, value in asdict(status.validation).items() if self._board else ():
                if value is not None:
                    self._board.add_scalar(f"validation/{name}", value, status.pictures)
            self._show(status.pictures)

    def _show(self, pictures: int) -> None:
        if self._board and self._data:
            self._snapshots = self._snapshots or Snapshots(self._folder, self._data, self._board)
            self._snapshots.take(pictures)

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self._lines.close()
        if self._snapshots:
            self._snapshots.close()
        if self._board:
            self._board.close()


def _board(folder: Path) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder))
