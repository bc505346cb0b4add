"""The tab for a generator of one's own, in a browser: sent, edited, learned, and estimated with."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from browsing import shoot, upload, visiting
from playwright.sync_api import expect
from serving import serving
from test_trainings import BLOCK, stand_in

pytestmark = pytest.mark.skipif(shutil.which("openscad") is None, reason="openscad is not installed")
WIDTH = 390


@pytest.fixture
def learning(studio, tmp_path, monkeypatch) -> Iterator[str]:
    stand_in(monkeypatch)
    with serving(studio, tmp_path / "served", learn=tmp_path / "learned") as address:
        yield address
    for name in set(studio.names) - {"box"}:
        studio.forget(name)


@pytest.fixture
def source(tmp_path) -> Path:
    path = tmp_path / "block.scad"
    path.write_text(BLOCK)
    return path


def test_a_generator_is_sent_edited_learned_and_estimated_with(browser, learning, source, picture):
    with visiting(browser, learning) as visit:
        page = visit(width=1366, height=768)
        page.locator("#tab-own").click()
        expect(page.locator("#code-note")).to_contain_text("Python files are refused")
        page.locator("#source").set_input_files(source)
        expect(page.locator("#training-note")).to_have_text("Ready to be learned.")
        expect(page.locator("#samples img")).to_have_count(6)
        assert page.evaluate(
            "() => document.querySelector('#ask').scrollWidth <= document.querySelector('#ask').clientWidth"
        )
        shoot(page, "own-proposed")
        page.get_by_label("Highest height").fill("40")
        page.get_by_label("width", exact=True).uncheck()
        page.get_by_role("button", name="Learn").click()
        expect(page.locator("#toasts")).to_contain_text("You have edited ranges")
        page.get_by_role("button", name="Try these ranges").click()
        expect(page.locator("#ranges")).to_have_attribute("inert", "")
        expect(page.locator("#training-note")).to_have_text("Ready to be learned.")
        expect(page.get_by_label("Highest height")).to_have_value("40")
        expect(page.locator("[data-range=width]")).to_have_class(re.compile("held"))
        page.get_by_role("button", name="Learn").click()
        expect(page.locator("#training-note")).to_contain_text("Step")
        page.locator("#stop-own").click()
        expect(page.locator("#training-note")).to_contain_text("Stopped")
        shoot(page, "own-stopped")
        page.reload()
        page.locator("#tab-own").click()
        page.get_by_role("button", name="Go on").click()
        page.get_by_role("button", name="Estimate with it").click()
        expect(page.locator("#wanted")).to_have_value("block")
        upload(page, picture)
        expect(page.locator("[data-name=height]")).to_be_visible()
        shoot(page, "own-estimated")
        page.locator("#tab-own").click()
        page.locator("#delete-own").click()
        expect(page.locator("#training")).to_be_hidden()
        expect(page.locator("#wanted option[value=block]")).to_have_count(0)


def test_the_tab_fits_a_phone(browser, learning, source):
    with visiting(browser, learning) as visit:
        page = visit(width=WIDTH, height=740, touch=True)
        page.locator("#tab-own").click()
        page.locator("#source").set_input_files(source)
        expect(page.locator("#training-note")).to_have_text("Ready to be learned.")
        assert page.evaluate("() => document.documentElement.scrollWidth") == WIDTH
        shoot(page, "own-phone")


def test_a_server_that_learns_nothing_says_how(visit):
    page = visit()
    page.locator("#tab-own").click()
    expect(page.locator("#own-closed")).to_contain_text("dipcg serve --learn FOLDER")
    expect(page.locator("#source")).to_be_hidden()
