"""The log of training: one line of JSON for each validation, and event files where TensorBoard is installed."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

from dipcg.training.snapshots import Snapshots
from dipcg.training.train import Status


class Log:
    """Writes validations to `log.jsonl` and, where TensorBoard is installed, curves to event files in the same folder.

    With a data set, the event files also have pictures: estimates of a few validation shapes by the checkpoint in the
    folder (`Snapshots`).
    """

    def __init__(self, folder: Path, data: Path | None = None) -> None:
        self._data = data
        self._snapshots: Snapshots | None = None
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._lines = (folder / "log.jsonl").open("a")

    # The event file is made with the first status, because only one of several processes reports.
    @cached_property
    def _writer(self) -> Any:
        return _event_writer(self._folder)

    def __call__(self, status: Status) -> None:
        """Write one status of training."""
        if self._writer:
            self._writer.add_scalar("loss", status.loss, status.pictures)
            self._writer.add_scalar("waiting for pictures", status.waiting, status.pictures)
        if status.validation:
            self._lines.write(json.dumps(asdict(status)) + "\n")
            self._lines.flush()
            for name, value in asdict(status.validation).items() if self._writer else ():
                if value is not None:
                    self._writer.add_scalar(f"validation/{name}", value, status.pictures)
            self._take_snapshot(status.pictures)

    def _take_snapshot(self, pictures: int) -> None:
        if self._writer and self._data:
            self._snapshots = self._snapshots or Snapshots(self._folder, self._data, self._writer)
            self._snapshots.take(pictures)

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self._lines.close()
        if self._snapshots:
            self._snapshots.close()
        if self._writer:
            self._writer.close()


def _event_writer(folder: Path) -> Any:
    """The writer of TensorBoard's event files, or None where TensorBoard is not installed."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder))
