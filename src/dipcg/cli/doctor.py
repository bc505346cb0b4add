"""Checks of this machine: what is missing, and the command that installs it. Child processes import what is heavy."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterable
from ctypes.util import find_library
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory

from dipcg import registry
from dipcg.model.zoo import SHIPPED

MIN_MEMORY_GB = 4.0
CHILD_TIMEOUT_S = 60.0

# The shared libraries, and the Debian packages that have them.
OPENGL = {"EGL": "libegl1", "GL": "libgl1"}
OPENCV = {"gthread-2.0": "libglib2.0-0", "GL": "libgl1"}
OPENGL_DRIVER = ("libegl-mesa0", "libgl1-mesa-dri")
BLENDER = {
    "Xrender": "libxrender1",
    "Xi": "libxi6",
    "xkbcommon": "libxkbcommon0",
    "SM": "libsm6",
    "ICE": "libice6",
    "Xxf86vm": "libxxf86vm1",
    "Xfixes": "libxfixes3",
    "EGL": "libegl1",
    "GL": "libgl1",
}


@dataclass(frozen=True)
class Check:
    """The result of one check, and the command that helps when it is not `ok`."""

    name: str
    ok: bool
    result: str
    fix: str = ""


def checks() -> list[Check]:
    """Run all checks, which takes a few seconds since one of them starts Blender."""
    return [check() for check in CHECKS] + [check_checkpoint(name) for name in registry.names("generators")]


def report(results: list[Check]) -> str:
    """The checks as an aligned table, with a command under each that failed."""
    width = max(len(check.name) for check in results)
    return "\n".join(_line(check, width) for check in results)


def check_python() -> Check:
    return _check("Python", sys.version_info >= (3, 11), platform.python_version(), "make install")


def check_opengl() -> Check:
    """Whether OpenGL works without a window, and which driver draws."""
    context = "moderngl.create_context(standalone=True, backend='egl')"
    ok, result = _child(f"import moderngl; send({context}.info['GL_RENDERER'])")
    return _check("OpenGL", ok, result, apt_install([*OPENGL.values(), *OPENGL_DRIVER]))


def check_opencv() -> Check:
    """Whether `cv2` can be imported, which links to libraries of the system."""
    ok, result = _child("import cv2; send(cv2.__version__)")
    return _check("OpenCV", ok, result, apt_install(OPENCV.values()))


def check_libraries() -> Check:
    """Whether the shared libraries that Blender's module links to are installed."""
    missing = [name for name in BLENDER if sys.platform == "linux" and find_library(name) is None]
    result = f"missing: {', '.join(f'lib{name}' for name in missing)}" if missing else "installed"
    return _check("Blender's libraries", not missing, result, apt_install([BLENDER[name] for name in missing]))


def check_infinigen() -> Check:
    return _installed("Infinigen", "infinigen", _install_infinigen())


def check_blender() -> Check:
    """Whether `bpy` can be imported, in a process of its own."""
    ok, result = _child("import bpy; send(bpy.app.version_string)")
    lacks_library = "cannot open shared object" in result
    return _check("Blender (bpy)", ok, result, apt_install(BLENDER.values()) if lacks_library else _install_infinigen())


def check_openscad() -> Check:
    """Whether OpenSCAD is installed; only generators from .scad files need it, so that to have none is no failure."""
    found = shutil.which("openscad")
    return Check("OpenSCAD", True, found or f"none, for .scad files only: {apt_install(['openscad'])}")


def check_torch() -> Check:
    """Which torch is installed, and which instructions for bfloat16 this processor has."""
    check = _installed("torch", "torch", "pip install torch")
    flags = " ".join(sorted({"avx512_bf16", "amx_bf16", "bf16"} & _cpu_flags()))
    return Check(check.name, check.ok, f"{check.result}, bfloat16 in hardware: {flags or 'no'}", check.fix)


def check_memory() -> Check:
    """Whether enough memory is free for Blender and torch side by side; True where it cannot be read."""
    match = re.search(r"MemAvailable:\s+(\d+)", _read("/proc/meminfo"))
    if match is None:
        return Check("Memory", True, "unknown on this system")
    free_gb = int(match[1]) / 2**20
    result = f"{free_gb:.1f} GB free, {MIN_MEMORY_GB:g} GB needed"
    close_some = "ps aux --sort=-rss | head  # close some of the programs that it lists"
    return _check("Memory", free_gb >= MIN_MEMORY_GB, result, close_some)


def check_cores() -> Check:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return Check("Cores", True, str(cores))


def check_checkpoint(generator: str) -> Check:
    """The size of the trained weights that ship for a generator; to have none is no failure."""
    size_mb = sum(path.stat().st_size for path in (SHIPPED / generator).rglob("*.safetensors")) / 1e6
    none = f"none: `dipcg sample {generator}` works, `dipcg estimate` after `dipcg train {generator}`"
    return Check(f"Weights: {generator}", True, f"{size_mb:.1f} MB" if size_mb else none)


CHECKS: tuple[Callable[[], Check], ...] = (
    check_python,
    check_opengl,
    check_opencv,
    check_libraries,
    check_infinigen,
    check_blender,
    check_openscad,
    check_torch,
    check_memory,
    check_cores,
)


def apt_install(packages: Iterable[str]) -> str:
    """The command that installs Debian packages, with sudo for those who need it and have it."""
    sudo = "sudo " if os.geteuid() != 0 and shutil.which("sudo") else ""
    return f"{sudo}apt-get install -y {' '.join(dict.fromkeys(packages))}"


def _install_infinigen() -> str:
    # Blender 4.2's module exists for Python 3.11 alone, and `make install` makes an environment of it.
    return "pip install 'dipcg[infinigen]'" if sys.version_info[:2] == (3, 11) else "make install"


def _check(name: str, ok: bool, result: str, fix: str) -> Check:
    return Check(name, ok, result, "" if ok else fix)


def _installed(name: str, package: str, fix: str) -> Check:
    try:
        return Check(name, True, version(package))
    except PackageNotFoundError:
        return Check(name, False, "not installed", fix)


def _child(code: str) -> tuple[bool, str]:
    """Run code that calls `send(text)` in another process: that text, or the last line of its error."""
    # Blender ends slowly and may print after the result, so the process stops at once.
    prelude = "import os\ndef send(text): print('\\nresult', text, flush=True); os._exit(0)\n"
    try:
        done = _run([sys.executable, "-P", "-c", prelude + code])
    except subprocess.TimeoutExpired:
        return False, f"no result within {CHILD_TIMEOUT_S:g} s"
    results = re.findall(r"^result (.*)$", done.stdout, re.MULTILINE)
    if results:
        return True, results[-1]
    return False, (done.stderr.strip().splitlines() or [f"the process ended with code {done.returncode}"])[-1]


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    # Blender leaves temporary files behind; they go with the folder.
    with TemporaryDirectory(prefix="dipcg-", ignore_cleanup_errors=True) as folder:
        return subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=CHILD_TIMEOUT_S,
            env=os.environ | {"TMPDIR": folder},
        )  # fmt: skip


def _cpu_flags() -> set[str]:
    match = re.search(r"^(?:flags|Features)\s*: (.*)$", _read("/proc/cpuinfo"), re.MULTILINE)
    return set(match[1].split()) if match else set()


def _read(path: str) -> str:
    return Path(path).read_text() if Path(path).is_file() else ""


def _line(check: Check, width: int) -> str:
    result = textwrap.shorten(check.result, 160, placeholder=" …")
    line = f"{'ok     ' if check.ok else 'MISSING'}  {check.name:<{width}}  {result}"
    return line if check.ok else f"{line}\n{'':<{width + 11}}→ {check.fix}"
