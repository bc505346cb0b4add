"""The weekly look at published holes covers every package that decodes what strangers send."""

import re
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).parents[2]
PINS = dict(re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / "constraints.txt").read_text(), re.MULTILINE))
# The first versions without the holes that were published until 2026-11: CVE-2025-48379, CVE-2023-4863, CVE-2023-47248.
SAFE = {"pillow": "11.3.0", "opencv-python": "4.8.1.78", "pyarrow": "14.0.1", "numpy": "1.22.2"}


@pytest.mark.parametrize("package", SAFE)
def test_what_decodes_strangers_data_is_pinned_and_cannot_be_older_than_the_mended_version(package):
    text = (ROOT / "pyproject.toml").read_text()
    lowest = re.search(rf'"{package}(>=[\d.]+)"', text)
    assert lowest is not None
    mended = Version(SAFE[package])
    assert Version(PINS[package]) >= mended
    assert Version(next(iter(Requirement(package + lowest[1]).specifier)).version) >= mended


def test_the_weekly_workflow_runs_the_audit_of_all_pins():
    assert "run: make audit" in (ROOT / ".github" / "workflows" / "weekly.yml").read_text()
    recipe = re.search(r"^audit:.*\n\t(.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert recipe is not None
    assert "pip-audit --strict" in recipe[1]
    assert "-r constraints.txt" in recipe[1]
