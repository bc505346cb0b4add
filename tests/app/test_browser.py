"""The app in a real browser, Debian's Chromium without a screen: what a visitor does, on a desk and on a phone.

Screenshots are left in out/screenshots for people to look at.
"""

import contextlib
import re
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest
import trimesh
from boxes import BOX
from playwright.sync_api import Locator, Page, expect, sync_playwright

from dipcg.export.asset import Asset
from dipcg.images import load_image, save_image
from dipcg.space import Params, params_from_json

SHOTS = Path(__file__).parents[2] / "out" / "screenshots"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
ALONE = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
PATIENCE_MS = 60_000
expect.set_options(timeout=PATIENCE_MS)

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium, or make system")


@pytest.fixture(scope="module")
def browser():
    """One browser, whose pages share what it has read of Gradio's scripts; every page is a visitor of its own."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[*SOFTWARE, ALONE])
        yield browser.new_context(reduced_motion="reduce")
        browser.close()


@pytest.fixture
def visit(browser, address):
    """Opens the page; nothing but this machine can be reached, or is asked for, and no script may fail."""
    opened, problems = [], []

    def visit(width: int = 1400, height: int = 950) -> Page:
        page = browser.new_page()
        page.set_viewport_size({"width": width, "height": height})
        page.set_default_timeout(PATIENCE_MS)
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("request", lambda request: asked(request.url))
        page.goto(address)
        page.wait_for_selector("#viewer .empty")
        opened.append(page)
        return page

    def asked(url: str) -> None:
        if not url.startswith((address, "data:", "blob:")):
            problems.append(f"asked for {url}")

    yield visit
    for page in opened:
        page.close()
    assert not problems


def upload(page: Page, picture: Path) -> None:
    """Give the page a picture and wait until an asset is open."""
    page.locator("#picture input[type=file]").set_input_files(picture)
    page.wait_for_selector("#candidates button[aria-pressed=true]")
    page.wait_for_selector("#viewer canvas[data-faces]")


def nudge(slider: Locator) -> None:
    """Move a slider by ones from zero with the keyboard; a key pressed while the page is redrawn may be lost."""
    for presses in (1, 2, 3):
        slider.press("ArrowRight")
        with contextlib.suppress(AssertionError):
            return expect(slider).to_have_value(re.compile(f"^[1-{presses}]$"), timeout=5000)
    raise AssertionError("The slider does not follow the keyboard.")


def seen(page: Page) -> str:
    """What the viewer shows, as text that differs where the picture does."""
    return page.evaluate("() => document.querySelector('#viewer canvas').dataset.drawn")


def number(page: Page, name: str):
    return page.locator(f"[data-name={name}] input[type=number]")


def move(page: Page, name: str, value: float) -> None:
    number(page, name).fill(str(value))
    number(page, name).press("Enter")


def downloaded(page: Page, ending: str, folder: Path) -> Path:
    page.locator("#format input").click()
    page.get_by_role("option", name=ending, exact=True).click()
    with page.expect_download() as waiting:
        page.locator("#download").click()
    target = folder / waiting.value.suggested_filename
    waiting.value.save_as(target)
    return target


def shoot(page: Page, name: str) -> None:
    SHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SHOTS / f"{name}.png", full_page=True)


def test_from_a_picture_to_an_edited_file(visit, picture, tmp_path):
    page = visit()
    shoot(page, "empty")
    upload(page, picture)
    candidates = page.locator("#candidates button")
    assert candidates.count() > 1
    agreements = [int(words.split()[0]) for words in candidates.all_inner_texts()]
    assert all(0 < agreement <= 100 for agreement in agreements)
    before = seen(page)
    candidates.nth(1).click()
    expect(page.locator("#viewer canvas")).not_to_have_attribute("data-drawn", before)
    expect(candidates.nth(1)).to_have_attribute("aria-pressed", "true")
    before = seen(page)
    move(page, "width", 0.95)
    expect(page.locator("#viewer canvas")).not_to_have_attribute("data-drawn", before)
    shoot(page, "edited")
    params = params_from_json(downloaded(page, ".json", tmp_path).read_text())[1]
    assert BOX.validate(params) == params
    assert params["width"] == 0.95
    mesh = trimesh.load(downloaded(page, ".glb", tmp_path))
    over = 0 if params["top"] == "open" else params["overhang"]
    assert mesh.extents[0] == pytest.approx(0.95 + 2 * over, abs=1e-4)
    page.get_by_role("button", name="The command that makes it again").click()
    expect(page.locator("#command")).to_contain_text("width=0.95")


def test_from_a_sentence_to_an_asset_that_is_estimated_again_around_what_is_held(visit):
    page = visit()
    page.get_by_role("tab", name="Words").click()
    page.locator("#words textarea").fill("a low box with legs")
    page.locator("#use-words").click()
    page.wait_for_selector("#viewer canvas[data-faces]")
    assert page.locator("#candidates .photo").count() == 0, "there is no picture to stand beside"
    shoot(page, "words")
    move(page, "width", 0.77)
    page.locator("[data-name=width] .hold").click()
    expect(page.locator("[data-name=width] .hold")).to_have_attribute("aria-pressed", "true")
    before = seen(page)
    page.get_by_role("button", name="Estimate the rest again").click()
    expect(page.locator("#viewer canvas")).not_to_have_attribute("data-drawn", before)
    expect(number(page, "width")).to_have_value("0.770")


def test_edits_hide_what_does_nothing_can_be_undone_and_can_be_held(visit, picture):
    page = visit()
    upload(page, picture)
    page.locator("#parameters details").evaluate_all("all => all.forEach(one => (one.open = true))")
    top = page.locator("[data-name=top] select")
    for option, shown in [("open", False), ("pyramid", True)]:
        top.select_option(index=["open", "flat", "pyramid"].index(option))
        expect(page.locator("[data-name=lid_height]")).to_be_visible(visible=shown)
    width = number(page, "width").input_value()
    move(page, "width", 0.31)
    page.get_by_role("button", name="Undo").click()
    expect(number(page, "width")).to_have_value(width)

    move(page, "width", 0.77)
    hold = page.locator("[data-name=width] .hold")
    hold.click()
    expect(hold).to_have_attribute("aria-pressed", "true")
    before = seen(page)
    page.get_by_role("button", name="Estimate the rest again").click()
    expect(page.locator("#viewer canvas")).not_to_have_attribute("data-drawn", before)
    expect(number(page, "width")).to_have_value("0.770")


def test_a_keyboard_is_enough(visit):
    page = visit()
    page.get_by_role("button", name="Random").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("#viewer canvas[data-faces]")
    before = seen(page)
    page.locator("#viewer canvas").focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator("#viewer canvas")).not_to_have_attribute("data-drawn", before)
    slider = page.locator("#p-width")
    slider.focus()
    value = float(slider.input_value())
    page.keyboard.press("ArrowLeft" if value > 0.6 else "ArrowRight")
    expect(number(page, "width")).not_to_have_value(f"{value:.3f}")


def test_problems_are_told_in_sentences_and_a_drawing_is_a_picture_too(visit, tmp_path):
    page = visit()
    (tmp_path / "notes.png").write_text("no picture at all")
    page.locator("#picture input[type=file]").set_input_files(tmp_path / "notes.png")
    expect(page.get_by_text("This is not a picture in a known format")).to_be_visible(timeout=PATIENCE_MS)
    assert "Traceback" not in page.content()
    page.locator("#download").click()
    expect(page.get_by_text("There is nothing to download yet")).to_be_visible(timeout=PATIENCE_MS)
    page.get_by_role("tab", name="Draw").click()
    page.get_by_role("button", name="Use the sketch").click()
    expect(page.get_by_text("The sketch is empty")).to_be_visible()
    sheet = page.locator("#sketch canvas").bounding_box()
    corner = [sheet["x"] + 0.3 * sheet["width"], sheet["y"] + 0.3 * sheet["height"]]
    page.mouse.move(*corner)
    page.mouse.down()
    for right, down in ((120, 0), (120, 120), (0, 120), (0, 0)):
        page.mouse.move(corner[0] + right, corner[1] + down, steps=8)
    page.mouse.up()
    page.get_by_role("button", name="Use the sketch").click()
    page.wait_for_selector("#viewer canvas[data-faces]")
    page.get_by_role("button", name="Correct the cut-out").click()
    page.get_by_label("own mask").check()
    expect(page.get_by_text("Add a mask.")).to_be_visible()


def test_a_crop_is_made_by_keyboard_seen_and_taken_away_by_the_next_picture(visit, picture, tmp_path):
    page, two = visit(), tmp_path / "two.png"
    image = load_image(picture)
    save_image(np.hstack([image, image]), two)
    upload(page, two)
    page.get_by_role("button", name="Correct the cut-out").click()
    seen_whole = page.locator("#cut-out img").get_attribute("src")
    right = page.get_by_role("slider", name="Crop right")
    nudge(right)
    right.fill("50")
    expect(page.locator("#cut-out img")).not_to_have_attribute("src", seen_whole or "")
    before = page.locator("#candidates .photo img").get_attribute("src")
    page.get_by_role("button", name="Estimate from this cut-out").click()
    expect(page.locator("#candidates .photo img")).not_to_have_attribute("src", before or "")
    page.get_by_label("Remove Image").first.click()
    upload(page, picture)
    expect(right).to_have_value("0")


def test_a_phone_sees_everything_without_scrolling_sideways(visit, picture):
    page = visit(width=375, height=740)
    upload(page, picture)
    page.wait_for_selector("[data-name=width]")
    wide = page.evaluate("() => [document.documentElement.scrollWidth, innerWidth]")
    assert wide[0] <= wide[1]
    for place in ("#picture", "#candidates", "#viewer", "#download", "[data-name=width]"):
        box = page.locator(place).first.bounding_box()
        assert box["x"] >= 0, place
        assert box["x"] + box["width"] <= 375, place
    shoot(page, "phone")


def test_visitors_do_not_see_each_other(visit):
    first, second = visit(), visit()
    for page in (first, second):
        page.get_by_role("button", name="Random").click()
        page.wait_for_selector("[data-name=depth]")
    theirs = number(second, "depth").input_value()
    move(first, "depth", 0.3)
    expect(number(first, "depth")).to_have_value("0.300")
    second.get_by_role("button", name="Reset").click()
    expect(number(second, "depth")).to_have_value(theirs)


def test_the_last_edit_wins_over_a_slower_one_before_it(visit, studio, monkeypatch):
    begun, go, build = threading.Event(), threading.Event(), studio.build

    def slowly(name: str, params: Params, *more: str) -> Asset:
        if params["width"] == 0.9:
            begun.set()
            assert go.wait(PATIENCE_MS / 1000)
        return build(name, params, *more)

    page = visit()
    page.get_by_role("button", name="Random").click()
    page.wait_for_selector("[data-name=width]")
    width = number(page, "width").input_value()
    monkeypatch.setattr(studio, "build", slowly)
    move(page, "width", 0.9)
    while not begun.is_set():
        page.wait_for_timeout(20)
    page.get_by_role("button", name="Undo").click()
    expect(number(page, "width")).to_have_value(width)
    go.set()
    move(page, "depth", 0.6)
    expect(number(page, "depth")).to_have_value("0.600")
    expect(number(page, "width")).to_have_value(width)
