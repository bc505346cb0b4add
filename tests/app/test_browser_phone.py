"""The page on a phone: short, wide enough for fingers, and at the result when it is there."""

from browsing import downloaded, shoot, upload
from playwright.sync_api import Page

WIDTH, HEIGHT = 390, 740
# The least height of what a finger presses, in pixels, and the most of the page with a result.
FINGER, LONG = 40, 2200
SMALL = """(least) => [...document.querySelectorAll('button, a, select, summary, textarea, input, .segments label')]
    .filter((one) => one.checkVisibility({ opacityProperty: true }) && one.getBoundingClientRect().height < least)
    .map((one) => one.outerHTML)"""


def small(page: Page) -> list[str]:
    return page.evaluate(SMALL, FINGER)


def test_a_phone_sees_everything_without_scrolling_sideways(visit, picture, tmp_path):
    page = visit(width=WIDTH, height=HEIGHT, touch=True)
    assert small(page) == []
    upload(page, picture)
    page.wait_for_function("() => document.querySelector('#result').getBoundingClientRect().top < innerHeight / 2")
    assert page.evaluate("() => document.documentElement.scrollWidth") == WIDTH
    assert page.evaluate("() => document.documentElement.scrollHeight") < LONG
    shoot(page, "phone")
    page.locator(".part").evaluate_all("all => all.forEach(one => (one.open = true))")
    assert small(page) == []
    for place in ("#drop", "#candidates", "#viewer", "#download", "[data-name=width]"):
        box = page.locator(place).first.bounding_box()
        assert box["x"] >= 0, place
        assert box["x"] + box["width"] <= WIDTH, place
    assert downloaded(page, ".glb", tmp_path).stat().st_size > 500


def test_download_is_above_the_fold_of_a_small_desk(visit, picture):
    page = visit(width=1366, height=768)
    upload(page, picture)
    page.wait_for_function("() => document.querySelector('#file-size').textContent.includes('triangles')")
    box = page.locator("#download").bounding_box()
    assert box["y"] + box["height"] <= 768
    shoot(page, "small-desk")
