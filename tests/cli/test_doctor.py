"""`dipcg doctor` names each missing thing and a command that helps, and imports nothing heavy in its own process."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dipcg import registry
from dipcg.cli import doctor
from dipcg.cli.doctor import Check

COMMANDS = {"apt-get", "sudo", "pip", "make", "ps"}
LIBRARIES = doctor.OPENGL | doctor.OPENCV | doctor.BLENDER
PACKAGES = {*LIBRARIES.values(), *doctor.OPENGL_DRIVER}


def everything_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "find_library", lambda name: None)
    monkeypatch.setattr(doctor, "_child", lambda code: (False, "ModuleNotFoundError: No module named 'x'"))
    monkeypatch.setattr(doctor, "_read", lambda path: "MemAvailable:   1048576 kB")
    monkeypatch.setattr(doctor, "version", not_installed)


def not_installed(name: str) -> str:
    raise doctor.PackageNotFoundError(name)


def test_every_failing_check_names_a_command(monkeypatch: pytest.MonkeyPatch) -> None:
    everything_fails(monkeypatch)
    failed = [check for check in doctor.checks() if not check.ok]
    assert {check.name for check in failed} >= {"OpenGL", "OpenCV", "Blender (bpy)", "Infinigen", "torch", "Memory"}
    for check in failed:
        assert check.result
        assert check.fix.split()[0] in COMMANDS, check


def test_a_passing_check_names_no_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_child", lambda code: (True, "4.2.0"))
    assert all(check.fix == "" for check in doctor.checks() if check.ok)


def test_every_generator_has_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_child", lambda code: (True, "4.2.0"))
    names = {check.name for check in doctor.checks()}
    assert {f"Weights: {name}" for name in registry.names("generators")} <= names


@pytest.mark.parametrize(("library", "package"), doctor.BLENDER.items())
def test_a_missing_library_is_reported_with_its_package(
    library: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "find_library", lambda name: None if name == library else f"lib{name}.so.1")
    check = doctor.check_libraries()
    assert not check.ok
    assert f"lib{library}" in check.result
    assert check.fix.endswith(f"apt-get install -y {package}")


def test_a_library_that_blender_fails_to_load_is_installed_by_apt(monkeypatch: pytest.MonkeyPatch) -> None:
    error = "ImportError: libXrender.so.1: cannot open shared object file: No such file or directory"
    monkeypatch.setattr(doctor, "_child", lambda code: (False, error))
    assert "libxrender1" in doctor.check_blender().fix


def test_the_makefile_installs_all_packages_of_the_doctor() -> None:
    makefile = (Path(__file__).parents[2] / "Makefile").read_text()
    for package in PACKAGES:
        assert re.search(rf"\b{re.escape(package)}\b", makefile), f"{package} is not in the Makefile"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("apt-cache") is None, reason="needs Debian's package lists")
def test_debian_knows_the_packages() -> None:
    known = subprocess.run(["apt-cache", "pkgnames"], capture_output=True, text=True).stdout.split()
    if len(known) < 10_000:
        pytest.skip("the package lists have not been fetched")
    assert set(known) >= PACKAGES


def test_sudo_only_where_it_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: "/usr/bin/sudo")
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert doctor.apt_install(["libegl1"]) == "apt-get install -y libegl1"
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert doctor.apt_install(["libegl1", "libegl1"]) == "sudo apt-get install -y libegl1"


@pytest.mark.parametrize(("code", "expected"), [
    ("print('other output'); send('yes'); print('never')", (True, "yes")),
    ("raise RuntimeError('no EGL')", (False, "RuntimeError: no EGL")),
    ("import os; os._exit(3)", (False, "the process ended with code 3")),
    ("import os; os.abort()", (False, "the process ended with code -6")),
])  # fmt: skip
def test_a_child_process_gives_its_result_or_the_reason(code: str, expected: tuple[bool, str]) -> None:
    assert doctor._child(code) == expected


def test_a_child_that_hangs_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "CHILD_TIMEOUT_S", 0.5)
    assert doctor._child("import time; time.sleep(60)") == (False, "no result within 0.5 s")


def test_unreadable_memory_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_read", lambda path: "")
    assert doctor.check_memory().ok


@pytest.mark.parametrize(("flags", "named"), [("fpu avx512_bf16 amx_bf16", "amx_bf16 avx512_bf16"), ("fpu avx2", "no")])
def test_bfloat16_is_read_from_the_processor(flags: str, named: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_read", lambda path: f"processor\t: 0\nflags\t\t: {flags}\n")
    assert doctor.check_torch().result.endswith(f"bfloat16 in hardware: {named}")


def test_the_report_is_aligned_and_shows_the_command() -> None:
    lines = doctor.report(
        [Check("Python", True, "3.11"), Check("OpenGL", False, "no EGL", "apt-get install x")]
    ).splitlines()
    assert lines[0].index("3.11") == lines[1].index("no EGL") == lines[2].index("→")
    assert "apt-get install x" in lines[2]


def test_this_machine_really_draws_without_a_window() -> None:
    check = doctor.check_opengl()
    assert check.ok, check


@pytest.mark.blender
def test_this_machine_really_has_blender() -> None:
    if not doctor.check_infinigen().ok:
        pytest.skip("Infinigen is not installed")
    assert doctor.check_blender().result.startswith("4.")


@pytest.mark.blender
def test_nothing_heavy_is_imported_here() -> None:
    code = "import sys; from dipcg.cli import doctor; doctor.checks(); print({'torch', 'bpy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "set()", done.stdout + done.stderr
