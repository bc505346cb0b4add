"""A log of training: one line of JSON per validation, and TensorBoard's files when it is installed."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dipcg.train import Status


class Log:
    """Writes to `log.jsonl` and, with tensorboard installed, to event files in the same folder."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._lines = (folder / "log.jsonl").open("a")
        self._board = _board(folder)

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

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self._lines.close()
        if self._board:
            self._board.close()


def _board(folder: Path) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder))
