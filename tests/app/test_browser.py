"""The page in a real browser, Debian's Chromium without a screen: what a visitor does, on a desk and on a phone.

Screenshots are left in out/screenshots for people to look at.
"""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
import trimesh
from boxes import BOX
from browsing import downloaded, draw, hold_back, move, number, pixels, seen, shoot, shown, upload
from playwright.sync_api import expect

from dipcg.cli import main
from dipcg.images import load_image, save_image
from dipcg.parameter_file import params_from_json

# Gives the candidates of the open result other agreements.
AGREEING = """async (agreements) => {
    const state = await import("/scripts/state.js"), { open, results } = state.get();
    const [one] = results[open.result].candidates;
    const candidates = agreements.map((agreement) => ({ ...one, agreement }));
    state.set({ results: { ...results, [open.result]: { ...results[open.result], candidates } } });
}"""

# Makes the picture of the open result red on every part.
RED = """async () => {
    const state = await import("/scripts/state.js"), { open, results } = state.get();
    const parts = results[open.result].candidates.flatMap(({ colours }) => Object.keys(colours));
    const colours = Object.fromEntries(parts.map((part) => [part, [0.8, 0.2, 0.2]]));
    const candidates = results[open.result].candidates.map((one) => ({ ...one, colours }));
    state.set({ results: { ...results, [open.result]: { ...results[open.result], candidates } } });
}"""
# Types values into a field, one after the other.
TYPE = """(field, values) => values.forEach((value) => {
    field.value = value;
    field.dispatchEvent(new Event("change"));
})"""


def base_colours(file: Path) -> list[tuple[float, ...]]:
    """The colours of the materials of a GLB, in linear light."""
    data = file.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    return [tuple(one["pbrMetallicRoughness"]["baseColorFactor"][:3]) for one in document["materials"]]


def test_from_a_picture_to_an_edited_file(visit, picture, tmp_path):
    page = visit()
    shoot(page, "empty")
    upload(page, picture)
    before = seen(page)
    page.locator("#candidates button").nth(1).click()
    expect(page.locator("#candidates button").nth(1)).to_have_attribute("aria-pressed", "true")
    shown(page, before)
    before = seen(page)
    move(page, "width", 0.95)
    shown(page, before)
    shoot(page, "edited")
    params = params_from_json(downloaded(page, ".json", tmp_path).read_text())[1]
    assert BOX.validate(params) == params
    assert params["width"] == 0.95
    mesh = trimesh.load(downloaded(page, ".glb", tmp_path), force="mesh")
    over = 0 if params["top"] == "open" else params["overhang"]
    assert mesh.extents[0] == pytest.approx(0.95 + 2 * over, abs=1e-4)
    assert len(mesh.faces) == int(page.locator("#file-size").inner_text().split()[0])
    page.get_by_text("The command that makes it again").click()
    expect(page.locator("#command")).to_contain_text("width=0.95")


def test_candidates_stand_in_the_order_that_their_labels_say(visit, picture):
    page = visit()
    upload(page, picture)
    page.evaluate(AGREEING, [0.5, 0.7, 0.4, 0.9, 0.71])
    first, *others = page.locator("#candidates button").all_inner_texts()
    assert first == "Best guess"
    assert others == ["90 % match", "71 % match", "70 % match", "40 % match"]
    page.locator("#candidates button").nth(1).click()
    assert page.evaluate("() => import('/scripts/state.js').then((state) => state.get().open.chosen)") == 3
    expect(page.locator("#candidates-note")).to_contain_text("best guess first, then by how well they match")


def test_file_and_command_have_the_colours_of_the_photo_where_they_are_asked_for(visit, picture, tmp_path, monkeypatch):
    page = visit()
    upload(page, picture)
    seen(page)
    expect(page.locator("#look-photo")).to_be_checked()
    plain = pixels(page)
    page.get_by_text("Parts", exact=True).click()
    seen(page)
    assert pixels(page) != plain
    page.evaluate(RED)
    page.get_by_text("Photo", exact=True).click()
    seen(page)
    red, green, blue = pixels(page)
    assert red > 1.5 * max(green, blue)
    file = downloaded(page, ".glb", tmp_path)
    assert {tuple(np.round(colour, 3)) for colour in base_colours(file)} == {(0.604, 0.033, 0.033)}
    made = file.read_bytes()
    page.get_by_text("The command that makes it again").click()
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(page.locator("#command").inner_text())[1:]) in (None, 0)
    assert file.read_bytes() == made
    page.get_by_text("Materials", exact=True).click()
    assert (0.604, 0.033, 0.033) not in {
        tuple(np.round(one, 3)) for one in base_colours(downloaded(page, ".glb", tmp_path))
    }
    expect(page.locator("#command")).not_to_contain_text("--paint")


def test_menus_show_the_probabilities_of_the_picture_that_is_open(visit, picture, tmp_path):
    page, other, listed = visit(), tmp_path / "other.png", []
    save_image(np.ascontiguousarray(load_image(picture)[::-1]), other)
    for given in (picture, other):
        upload(page, given)
        told = page.evaluate(
            "() => { const s = JSON.parse(sessionStorage.dipcg); return s.results[s.open.result].probabilities.top }"
        )
        options = page.locator("[data-name=top] option").all_text_contents()
        assert [int(words.split(" · ")[1].split()[0]) for words in options] == [round(100 * p) for p in told.values()]
        listed.append(options)
    assert listed[0] != listed[1]


def test_from_a_sentence_to_an_asset_that_is_estimated_again_around_what_is_held(visit):
    page = visit()
    page.get_by_role("tab", name="Words").click()
    page.locator("#words").fill("a low box with legs")
    page.locator("#words").press("Enter")
    page.wait_for_selector("#viewer canvas[data-drawn]")
    assert page.locator("#candidates .photo").count() == 0, "there is no picture to stand beside"
    shoot(page, "words")
    move(page, "width", 0.77)
    page.locator("[data-name=width] .hold").click()
    expect(page.locator("[data-name=width] .hold")).to_have_attribute("aria-pressed", "true")
    before = seen(page)
    page.get_by_role("button", name="Estimate the rest again").click()
    shown(page, before)
    expect(number(page, "width")).to_have_value("0.770")
    expect(page.locator("[data-name=width] .hold")).to_have_attribute("aria-pressed", "true")


def test_edits_hide_what_does_nothing_and_each_is_one_step_to_undo(visit):
    page = visit()
    page.get_by_role("button", name="Random").click()
    page.locator(".part").evaluate_all("all => all.forEach(one => (one.open = true))")
    top = page.locator("[data-name=top] select")
    for option, there in [("open", False), ("pyramid", True)]:
        top.select_option(index=["open", "flat", "pyramid"].index(option))
        expect(page.locator("[data-name=lid_height]")).to_be_visible(visible=there)
    width = number(page, "width").input_value()
    box = page.locator("#p-width").bounding_box()
    page.mouse.move(box["x"] + 0.1 * box["width"], box["y"] + box["height"] / 2)
    page.mouse.down()
    for step in range(2, 10):
        page.mouse.move(box["x"] + 0.1 * step * box["width"], box["y"] + box["height"] / 2)
    page.mouse.up()
    dragged = number(page, "width").input_value()
    assert dragged != width
    page.get_by_role("button", name="Undo").click()
    expect(number(page, "width")).to_have_value(width)
    page.keyboard.press("Control+Shift+Z")
    expect(number(page, "width")).to_have_value(dragged)
    page.get_by_role("button", name="Reset").click()
    page.keyboard.press("Control+z")
    expect(number(page, "width")).to_have_value(dragged)


def test_a_hundred_edits_can_be_undone(visit):
    page = visit()
    page.get_by_role("button", name="Random").click()
    values = [round(0.3 + 0.005 * step, 3) for step in range(102)]
    field = number(page, "width")
    field.evaluate(TYPE, values)
    for _ in range(100):
        page.locator("#undo").evaluate("button => button.click()")
    expect(field).to_have_value(f"{values[1]:.3f}")
    expect(page.locator("#undo")).to_be_disabled()


def test_the_last_edit_wins_over_a_slower_one_before_it(visit):
    page = visit()
    page.get_by_role("button", name="Random").click()
    page.wait_for_selector("#viewer canvas[data-drawn]")
    release = hold_back(page, "**/assets/preview", lambda body: '"width":0.9,' in body)
    before = seen(page)
    move(page, "width", 0.9)
    page.wait_for_timeout(200)
    move(page, "depth", 0.6)
    move(page, "width", 0.4)
    shown(page, before)
    before = seen(page)
    release()
    page.wait_for_timeout(600)
    assert seen(page) == before
    expect(number(page, "width")).to_have_value("0.400")


def test_an_edit_made_while_an_estimate_is_ranked_stays(visit, picture):
    page = visit()
    release = hold_back(page, "**/events", lambda body: False)
    page.locator("#file").set_input_files(picture)
    page.wait_for_selector("#candidates button")
    move(page, "width", 0.61)
    release()
    expect(page.locator("#progress")).to_be_hidden()
    expect(number(page, "width")).to_have_value("0.610")


def test_an_estimate_can_be_cancelled_and_the_open_asset_stays(visit, picture):
    page = visit()
    page.get_by_role("button", name="Random").click()
    width = number(page, "width").input_value()
    release = hold_back(page, "**/jobs/*/events", lambda body: True)
    page.locator("#file").set_input_files(picture)
    with page.expect_request(lambda request: request.method == "DELETE"):
        page.get_by_role("button", name="Cancel").click()
    release()
    expect(page.locator("#progress")).to_be_hidden()
    expect(number(page, "width")).to_have_value(width)


def test_a_reload_keeps_the_work(visit, picture):
    page = visit()
    upload(page, picture)
    original = number(page, "width").input_value()
    move(page, "width", 0.33)
    page.locator("[data-name=depth] .hold").click()
    page.wait_for_timeout(400)
    page.reload()
    page.wait_for_selector("#viewer canvas[data-drawn]")
    expect(number(page, "width")).to_have_value("0.330")
    expect(page.locator("[data-name=depth] .hold")).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#candidates button").first).to_have_attribute("aria-pressed", "true")
    page.get_by_role("button", name="Undo").click()
    expect(number(page, "width")).to_have_value(original)


def test_a_keyboard_is_enough(visit):
    page = visit()
    page.get_by_role("button", name="Random").focus()
    page.keyboard.press("Enter")
    page.wait_for_selector("#viewer canvas[data-drawn]")
    before = seen(page)
    page.locator("#viewer canvas").focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator("#viewer canvas")).not_to_have_attribute("data-drawn", before)
    page.keyboard.press("Home")
    expect(page.locator("#viewer canvas")).to_have_attribute("data-drawn", before)
    slider = page.locator("#p-width")
    slider.focus()
    value = float(slider.input_value())
    page.keyboard.press("ArrowLeft" if value > 0.6 else "ArrowRight")
    expect(number(page, "width")).not_to_have_value(f"{value:.3f}")
    page.get_by_role("tab", name="Picture").focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator("#sheet")).to_be_visible()


def test_problems_are_told_in_sentences_and_a_drawing_is_a_picture_too(visit, tmp_path):
    page = visit()
    (tmp_path / "notes.png").write_text("no picture at all")
    page.locator("#file").set_input_files(tmp_path / "notes.png")
    expect(page.locator(".toast").first).to_contain_text("not a picture")
    assert "Traceback" not in page.content()
    page.locator("#download").click()
    expect(page.get_by_text("There is nothing to download yet")).to_be_visible()
    page.get_by_role("tab", name="Draw").click()
    page.get_by_role("button", name="Use the sketch").click()
    expect(page.get_by_text("The sketch is empty")).to_be_visible()
    draw(page, "#sheet", (0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7), (0.3, 0.3))
    page.get_by_role("button", name="Use the sketch").click()
    page.wait_for_selector("#viewer canvas[data-drawn]")
    page.get_by_role("tab", name="Picture").click()
    page.get_by_role("button", name="Correct the cut-out").click()
    page.get_by_label("Cut out", exact=True).select_option("mask")
    expect(page.get_by_text("Add a mask:")).to_be_visible()
