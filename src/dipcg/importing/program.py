"""Another Blender in which workers run: a Blender program, or a Python that has Blender's module."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tomllib
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from dipcg.importing.header import saved_by
from dipcg.registry import allow_code

TIMEOUT_S = 120.0
# The Python that our modules need; Blender has it since 4.1.
OLDEST = (3, 11)
# What the program says about itself.
QUESTION = """
import importlib.util, json, sys
import bpy
numpy = importlib.util.find_spec("numpy") is not None
print("\\ndipcg:" + json.dumps([bpy.app.version_string, sys.version_info[:2], numpy]), flush=True)
"""


def check_program(given: str) -> str:
    """The full path of a program that can build; raises ValueError with a sentence for one that cannot."""
    found = shutil.which(given)
    if found is None:
        raise ValueError(f"There is no program {given}; give the path of a Blender, or of a Python that has bpy.")
    # A link to Python stays as it is, because an environment is found by the place of the link.
    program = os.path.abspath(found)
    version, python, numpy = _ask(program)
    if tuple(python) < OLDEST:
        raise ValueError(f"{given} is Blender {version} with Python {python[0]}.{python[1]}; dipcg needs Blender 4.1.")
    if not numpy:
        raise ValueError(f"{given} is Blender {version} without NumPy; install NumPy for its Python (python3-numpy).")
    return program


def ours() -> tuple[int, int]:
    """The version of Blender's module in this environment; (0, 0) where there is none."""
    try:
        major, minor = version("bpy").split(".")[:2]
    except PackageNotFoundError:
        return 0, 0
    return int(major), int(minor)


def program_for(blend: Path, program: str) -> str:
    """Another Blender that reads a file: `program` if a newer Blender than ours saved it, else none, which is ours."""
    return program if saved_by(blend) > ours() else ""


def allow_program(toml: Path, program: str) -> None:
    """Let the Blender run that a TOML file names; raises ValueError with a sentence if it is not `program`."""
    named = tomllib.loads(toml.read_text(encoding="utf-8")).get("blender", "")
    if named not in ("", program):
        raise ValueError(f"{toml.name} needs the Blender that it was made with; give that with --blender.")
    if named:
        allow_code(toml)


def _ask(program: str) -> Any:
    is_python = "python" in Path(program).name.lower()
    words = ["-c"] if is_python else ["--background", "--factory-startup", "--python-expr"]
    try:
        done = subprocess.run([program, *words, QUESTION], capture_output=True, text=True, timeout=TIMEOUT_S)
        line = next(line for line in done.stdout.splitlines() if line.startswith("dipcg:"))
    except (StopIteration, OSError, subprocess.TimeoutExpired):
        raise ValueError(f"{program} is neither a Blender nor a Python that has bpy.") from None
    return json.loads(line.removeprefix("dipcg:"))
