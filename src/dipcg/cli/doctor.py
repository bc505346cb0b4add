"""What is missing on this machine, and the command that mends it; nothing heavy is imported in the calling process."""

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

OPENGL = {"EGL": "libegl1", "GL": "libgl1"}  # shared library: the Debian package that has it
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
    """One thing looked at: what was found, and when it is not `ok` the command that mends it."""

    name: str
    ok: bool
    found: str
    fix: str = ""


def checks() -> list[Check]:
    """Look at everything the package may need here; takes a few seconds, since Blender is started once."""
    looked_at = [check() for check in CHECKS]
    return looked_at + [check_checkpoint(name) for name in registry.names("generators")]


def report(found: list[Check]) -> str:
    """The checks as an aligned table, with the mending command under each that failed."""
    width = max(len(check.name) for check in found)
    return "\n".join(_line(check, width) for check in found)


def check_python() -> Check:
    return _check("Python", sys.version_info >= (3, 11), platform.python_version(), "make install PYTHON=python3.11")


def check_opengl() -> Check:
    """Whether a windowless context really opens, and which driver draws."""
    context = "moderngl.create_context(standalone=True, backend='egl')"
    ok, found = _child(f"import moderngl; answer({context}.info['GL_RENDERER'])")
    return _check("OpenGL", ok, found, apt_install([*OPENGL.values(), *OPENGL_DRIVER]))


def check_libraries() -> Check:
    """Whether the shared libraries that Blender's module links to are there."""
    missing = [name for name in BLENDER if sys.platform == "linux" and find_library(name) is None]
    found = f"missing: {', '.join(f'lib{name}' for name in missing)}" if missing else "all there"
    return _check("Blender's libraries", not missing, found, apt_install([BLENDER[name] for name in missing]))


def check_infinigen() -> Check:
    return _installed("Infinigen", "infinigen", _install_infinigen())


def check_blender() -> Check:
    """Whether `bpy` imports, in a process of its own."""
    ok, found = _child("import bpy; answer(bpy.app.version_string)")
    linked = "cannot open shared object" in found
    return _check("Blender (bpy)", ok, found, apt_install(BLENDER.values()) if linked else _install_infinigen())


def check_torch() -> Check:
    """Which torch is installed, and whether this processor computes in bfloat16 itself."""
    check = _installed("torch", "torch", "pip install torch")
    flags = " ".join(sorted({"avx512_bf16", "amx_bf16", "bf16"} & _cpu_flags()))
    return Check(check.name, check.ok, f"{check.found}, bfloat16 in hardware: {flags or 'no'}", check.fix)


def check_memory() -> Check:
    """Whether enough memory is free for Blender and torch side by side; True where it cannot be read."""
    match = re.search(r"MemAvailable:\s+(\d+)", _read("/proc/meminfo"))
    if match is None:
        return Check("Memory", True, "unknown on this system")
    free_gb = int(match[1]) / 2**20
    found = f"{free_gb:.1f} GB free, {MIN_MEMORY_GB:g} wanted"
    return _check("Memory", free_gb >= MIN_MEMORY_GB, found, "ps aux --sort=-rss | head  # and close what it lists")


def check_cores() -> Check:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return Check("Cores", True, str(cores))


def check_checkpoint(generator: str) -> Check:
    """Which trained weights ship for a generator; none is no fault."""
    size_mb = sum(path.stat().st_size for path in (SHIPPED / generator).rglob("*.safetensors")) / 1e6
    none = f"none: it can be sampled; after `dipcg train {generator}` it can be estimated"
    return Check(f"Weights: {generator}", True, f"{size_mb:.1f} MB" if size_mb else none)


CHECKS: tuple[Callable[[], Check], ...] = (
    check_python,
    check_opengl,
    check_libraries,
    check_infinigen,
    check_blender,
    check_torch,
    check_memory,
    check_cores,
)


def apt_install(packages: Iterable[str]) -> str:
    """The command that installs Debian packages, with sudo where it is needed and there."""
    sudo = "sudo " if os.geteuid() != 0 and shutil.which("sudo") else ""
    return f"{sudo}apt-get install -y {' '.join(dict.fromkeys(packages))}"


def _install_infinigen() -> str:
    # Blender 4.2's module exists for Python 3.11 alone
    return "pip install 'dipcg[infinigen]'" if sys.version_info[:2] == (3, 11) else "make install PYTHON=python3.11"


def _check(name: str, ok: bool, found: str, fix: str) -> Check:
    return Check(name, ok, found, "" if ok else fix)


def _installed(name: str, package: str, fix: str) -> Check:
    try:
        return Check(name, True, version(package))
    except PackageNotFoundError:
        return Check(name, False, "not installed", fix)


def _child(code: str) -> tuple[bool, str]:
    """Run code that calls `answer(text)` in another process: what it answered, or the last line of its error."""
    # os._exit: Blender's own shutdown is slow, and its chatter may come after the answer
    prelude = "import os\ndef answer(text): print('\\nanswer', text, flush=True); os._exit(0)\n"
    command = [sys.executable, "-c", prelude + code]
    try:
        with TemporaryDirectory(prefix="dipcg-", ignore_cleanup_errors=True) as folder:  # Blender leaves its own behind
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace", timeout=CHILD_TIMEOUT_S,
                env=os.environ | {"TMPDIR": folder},
            )  # fmt: skip
    except subprocess.TimeoutExpired:
        return False, f"no answer within {CHILD_TIMEOUT_S:g} s"
    answers = re.findall(r"^answer (.*)$", done.stdout, re.MULTILINE)
    if answers:
        return True, answers[-1]
    return False, (done.stderr.strip().splitlines() or [f"the process ended with code {done.returncode}"])[-1]


def _cpu_flags() -> set[str]:
    match = re.search(r"^(?:flags|Features)\s*: (.*)$", _read("/proc/cpuinfo"), re.MULTILINE)
    return set(match[1].split()) if match else set()


def _read(path: str) -> str:
    return Path(path).read_text() if Path(path).is_file() else ""


def _line(check: Check, width: int) -> str:
    found = textwrap.shorten(check.found, 160, placeholder=" …")
    line = f"{'ok     ' if check.ok else 'MISSING'}  {check.name:<{width}}  {found}"
    return line if check.ok else f"{line}\n{'':<{width + 11}}→ {check.fix}"
