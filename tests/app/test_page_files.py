"""The files of the page: they fit the policy of the server, and are small."""

import re
from pathlib import Path

import pytest

STATIC = Path(__file__).parents[2] / "src" / "dipcg" / "app" / "static"
OURS = sorted(
    path for kind in ("js", "css", "html") for path in STATIC.rglob(f"*.{kind}") if "vendor" not in path.parts
)
MOST_LINES = 200
# What is an address by its form alone: the name of a namespace.
NAMESPACE = "http://www.w3.org/2000/svg"

per_file = pytest.mark.parametrize("path", OURS, ids=lambda path: str(path.relative_to(STATIC)))


@per_file
def test_nothing_comes_from_another_host(path: Path) -> None:
    assert not re.search("https?://", path.read_text().replace(NAMESPACE, ""))


@per_file
def test_files_are_short(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= MOST_LINES


@pytest.mark.parametrize("path", [path for path in OURS if path.suffix == ".html"], ids=lambda path: path.name)
def test_no_script_or_style_is_inline(path: Path) -> None:
    text = path.read_text()
    assert "<style" not in text
    assert not re.search(r"\sstyle=|\son\w+=", text)
    assert all(not inside.strip() for inside in re.findall(r"<script[^>]*>(.*?)</script>", text, re.DOTALL))


def test_every_script_is_imported_and_every_style_linked() -> None:
    """Files that nothing names would be served and never read."""
    texts = {path: path.read_text() for path in OURS}
    for path in OURS:
        if path.parent.name in ("scripts", "styles"):
            assert any(path.name in text for other, text in texts.items() if other != path), path.name


def test_vendored_code_comes_with_its_licence() -> None:
    assert "MIT" in (STATIC / "vendor" / "LICENSE-three.txt").read_text()
