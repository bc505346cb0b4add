"""A temporary folder for each process that runs Blender."""

from __future__ import annotations

import os
from tempfile import TemporaryDirectory


def temporary_folder() -> tuple[TemporaryDirectory[str], dict[str, str]]:
    """A new temporary folder, and the environment for a process that is to use it.

    Blender leaves a folder of its own behind when its process is stopped. It lies inside this one and goes with it.
    """
    folder = TemporaryDirectory(prefix="dipcg-", ignore_cleanup_errors=True)
    return folder, os.environ | {"TMPDIR": folder.name}
