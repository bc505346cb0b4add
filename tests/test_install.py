"""What installs the package is consistent: pins, the Makefile, the image, the workflows and the markers of tests."""

from __future__ import annotations

import json
import os
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from markers import MARKED, TESTS
from packaging.requirements import Requirement

import dipcg

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PIP = ("PIP_FIND_LINKS", "PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL", "PIP_CERT", "TORCH", "CI", "CONSTRAINTS")


def requirements() -> list[Requirement]:
    """All that the package may install on Python 3.11, with the versions that override Infinigen's."""
    project = PROJECT["project"]
    lines = project["dependencies"] + [line for extra in project["optional-dependencies"].values() for line in extra]
    return [Requirement(line) for line in lines + PROJECT["tool"]["uv"]["override-dependencies"]]


def pins() -> dict[str, str]:
    """The version of each package in constraints.txt."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    return dict(line.split("==") for line in lines if not line.startswith("#"))


@pytest.mark.parametrize("required", requirements(), ids=str)
def test_each_package_is_pinned_to_a_version_in_its_range(required: Requirement) -> None:
    assert required.specifier.contains(pins()[required.name], prereleases=True)


def test_each_pin_is_an_exact_public_version() -> None:
    assert all(re.fullmatch(r"[0-9][0-9a-z.]*", version) for version in pins().values())


@pytest.mark.parametrize("place", sorted(place for places in MARKED.values() for place in places))
def test_each_marked_test_exists(place: str) -> None:
    file, _, name = place.partition("::")
    assert f"def {name}" in (TESTS / file).read_text()


def make(target: str, **settings: str) -> str:
    """The commands that a target would run, with nothing but these settings."""
    clean = {name: value for name, value in os.environ.items() if name not in PIP and not name.startswith("MAKE")}
    command = ["make", "--dry-run", "--always-make", "--no-print-directory", target]
    return subprocess.run(
        command, cwd=ROOT, env=clean | settings, capture_output=True, text=True, check=True
    ).stdout  # fmt: skip


@pytest.mark.parametrize(("settings", "expected"), [
    ({"PIP_FIND_LINKS": "wheels more"}, "UV_FIND_LINKS='wheels,more'"),
    ({"PIP_INDEX_URL": "file:index"}, "UV_DEFAULT_INDEX='file:index'"),
    ({"PIP_EXTRA_INDEX_URL": "file:a file:b"}, "UV_INDEX='file:a file:b'"),
    ({"PIP_CERT": "own.crt"}, "SSL_CERT_FILE='own.crt'"),
])  # fmt: skip
def test_uv_gets_the_settings_of_pip(settings: dict[str, str], expected: str) -> None:
    assert expected in make("install", **settings)
    assert expected.partition("=")[0] not in make("install")


@pytest.mark.parametrize(("settings", "torch"), [
    ({}, "--torch-backend auto"),
    ({"TORCH": "cpu"}, "--torch-backend cpu"),
    ({"TORCH": ""}, None),
    ({"CI": "true"}, None),
    ({"PIP_FIND_LINKS": "wheels"}, None),
    ({"PIP_FIND_LINKS": "wheels", "TORCH": "cpu"}, "--torch-backend cpu"),
])  # fmt: skip
def test_torch_comes_from_where_it_should(settings: dict[str, str], torch: str | None) -> None:
    commands = make("install", **settings)
    assert torch in commands if torch else "--torch-backend" not in commands


def test_every_target_that_is_run_is_one_of_the_makefile() -> None:
    known = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for path in [*WORKFLOWS, ROOT / ".ci" / "run", ROOT / "Dockerfile", ROOT / ".devcontainer" / "devcontainer.json"]:
        commands = re.sub(r"^ *#.*$", "", path.read_text(), flags=re.MULTILINE)
        targets = {name for line in re.findall(r"\bmake ([a-z -]+)", commands) for name in line.split()}
        assert targets <= known, f"{path.name} runs {', '.join(targets - known)}"
        assert targets or ".ci/run" in commands


def test_the_image_runs_a_command_that_exists() -> None:
    (command,) = re.findall(r"^CMD (.*)$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    program, *words = json.loads(command)
    assert program in PROJECT["project"]["scripts"]
    assert words[:1] == ["serve"]


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not in a repository")
def test_git_ignores_no_source() -> None:
    listing = ["git", "-c", "safe.directory=*", "ls-files", "--others", "--ignored", "--exclude-standard"]
    done = subprocess.run([*listing, "src", "tests"], cwd=ROOT, capture_output=True, text=True, check=True)
    names = done.stdout.splitlines()
    assert [name for name in names if "__pycache__" not in name] == []


def test_the_citation_has_the_version_of_the_package() -> None:
    assert f"\nversion: {dipcg.__version__}\n" in (ROOT / "CITATION.cff").read_text()
