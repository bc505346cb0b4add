"""Files that are written whole or not at all, and folders that one process works in at a time."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory


@contextlib.contextmanager
def written(path: str | Path) -> Iterator[Path]:
    """The place to write a file to: a path of the same name in a hidden folder beside `path`.

    When the block ends, the file replaces `path` in one step. What else the block wrote beside it, such as the material
    file of an OBJ, is moved first. After an error nothing has changed. A link is followed, so that it stays a link.
    Raises OSError with the name of `path` when the disk is full or the folder cannot be written to.
    """
    path = Path(path)
    target = path.resolve()
    try:
        with TemporaryDirectory(prefix=f".{target.stem[:40]}-", dir=target.parent) as folder:
            unfinished = Path(folder) / path.name
            yield unfinished
            for other in sorted(Path(folder).iterdir()):
                if other != unfinished:
                    _move(other, target.parent / other.name)
            _move(unfinished, target)
        _flush(target.parent)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None


def write_file(path: str | Path, content: bytes | str) -> None:
    """Write all of a file or nothing; text is UTF-8. Raises OSError as `written` does."""
    with written(path) as unfinished:
        unfinished.write_bytes(content if isinstance(content, bytes) else content.encode())


@contextlib.contextmanager
def locked(folder: Path, work: str) -> Iterator[None]:
    """Hold a folder, which is made if it is missing, for one process; the lock of a killed process is free again.

    Raises ValueError when another process holds it; `work` says what that one does, as in "builds a data set".
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".lock").open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f"Another process {work} in {folder}; wait until it is finished, or choose another folder."
            ) from None
        yield


def _move(file: Path, target: Path) -> None:
    """Put a file in the place of another when all of it is on the disk."""
    _flush(file)
    file.replace(target)


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
