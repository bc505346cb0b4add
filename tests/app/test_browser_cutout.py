"""Correcting the cut-out in a real browser: strokes, the crop by pointer and keys, and what is then asked for."""

import numpy as np
from browsing import draw, upload
from playwright.sync_api import Page, expect

from dipcg.images import load_image, save_image


def opened(page: Page, picture) -> None:
    upload(page, picture)
    page.get_by_role("button", name="Correct the cut-out").click()
    page.wait_for_selector("#cut img[src]")


def asked(page: Page, act) -> dict:
    """The corrections that the page sends after an act."""
    with page.expect_request("**/object") as sent:
        act()
    return sent.value.post_data_json


def test_strokes_say_what_is_the_object_and_what_is_not(visit, picture):
    page = visit()
    opened(page, picture)
    sent = asked(page, lambda: draw(page, "#strokes", (0.5, 0.5), (0.6, 0.5)))
    points = np.array(sent["foreground"][0]["points"])
    np.testing.assert_allclose(points[[0, -1]], [[0.5, 0.5], [0.6, 0.5]], atol=0.01)
    page.get_by_text("This is not", exact=True).click()
    sent = asked(page, lambda: draw(page, "#strokes", (0.1, 0.1)))
    np.testing.assert_allclose(sent["background"][0]["points"], [[0.1, 0.1]], atol=0.01)
    assert len(sent["foreground"]) == 1
    sent = asked(page, lambda: page.get_by_role("button", name="Undo mark").click())
    assert sent["background"] == []
    with page.expect_request("**/estimates") as estimate:
        page.get_by_role("button", name="Estimate from this").click()
    assert estimate.value.post_data_json["object"]["foreground"] == sent["foreground"]
    page.wait_for_selector("#progress", state="hidden")


def test_a_crop_is_dragged_and_moved_by_keys_and_goes_with_the_next_picture(visit, picture, tmp_path):
    page, two = visit(), tmp_path / "two.png"
    image = load_image(picture)
    save_image(np.ascontiguousarray(np.hstack([image, image])), two)
    opened(page, two)
    page.get_by_text("Crop", exact=True).click()
    sent = asked(page, lambda: draw(page, ".corner.right.bottom", (0.9, 0.9), (-4.5, 0.9)))
    assert 0.1 < sent["crop"]["right"] < 0.9
    assert sent["crop"]["left"] == 0
    corner = page.get_by_role("button", name="Corner at the top left")
    corner.focus()
    sent = asked(page, lambda: page.keyboard.press("ArrowRight"))
    assert round(sent["crop"]["left"], 2) == 0.02
    before = page.locator("#seen img").get_attribute("src")
    page.get_by_role("button", name="Estimate from this").click()
    expect(page.locator("#seen img")).not_to_have_attribute("src", before or "")
    page.wait_for_selector("#progress", state="hidden")
    upload(page, picture)
    page.get_by_role("button", name="Correct the cut-out").click()
    assert page.locator(".frame").evaluate("frame => frame.style.right") == "0%"
