"""Visits to the page in a browser."""

from collections.abc import Callable, Iterator

import pytest
from browsing import CHROMIUM, launched, visiting
from playwright.sync_api import Browser, Page, sync_playwright


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One browser for all tests; every page is a visitor of its own."""
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium, or make system")
    with sync_playwright() as playwright:
        browser = launched(playwright)
        yield browser
        browser.close()


@pytest.fixture
def visit(browser: Browser, address: str) -> Iterator[Callable[..., Page]]:
    """Opens the page for a new visitor."""
    with visiting(browser, address) as visit:
        yield visit
