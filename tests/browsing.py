"""What tests in a browser share: a visit that fails at the first fault of the page, and what a visitor does there."""

import contextlib
import logging
import re
import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from playwright.sync_api import Browser, Locator, Page, Playwright, Route, expect

from dipcg.images import load_image

SHOTS = Path(__file__).parents[1] / "out" / "screenshots"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
ALONE = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
PATIENCE_MS = 60_000
VIOLATIONS = """addEventListener("securitypolicyviolation", ({ violatedDirective, blockedURI }) => {
    throw new Error(`The policy was violated: ${violatedDirective} ${blockedURI}`);
})"""
# Resolves when the browser has drawn all that it was asked to draw so far.
TWO_FRAMES = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
expect.set_options(timeout=PATIENCE_MS)


def launched(playwright: Playwright) -> Browser:
    return playwright.chromium.launch(executable_path=CHROMIUM, args=[*SOFTWARE, ALONE])


@contextlib.contextmanager
def visiting(browser: Browser, address: str) -> Iterator[Callable[..., Page]]:
    """Opens the page for a new visitor.

    No script and no request may fail, and nothing may break the policy or ask for another host.
    """
    opened, problems = [], []

    def visit(width: int = 1400, height: int = 950, touch: bool = False) -> Page:
        size = {"width": width, "height": height}
        context = browser.new_context(viewport=size, reduced_motion="reduce", has_touch=touch, is_mobile=touch)  # type: ignore[arg-type]
        context.set_default_timeout(PATIENCE_MS)
        context.add_init_script(VIOLATIONS)
        page = context.new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("request", lambda request: asked(request.url))
        page.goto(address)
        page.wait_for_selector("body.ready")
        opened.append(context)
        return page

    def asked(url: str) -> None:
        if not url.startswith((address, "data:", "blob:")):
            problems.append(f"asked for {url}")

    with logged(problems):
        yield visit
    for context in opened:
        context.close()
    assert not problems


@contextlib.contextmanager
def logged(problems: list[str]) -> Iterator[None]:
    """Adds what the server, which runs in this process, logs as an error."""
    root, handler = logging.getLogger(), Errors(problems)
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)


class Errors(logging.Handler):
    """Puts the errors of the log in a list."""

    def __init__(self, found: list[str]) -> None:
        super().__init__(logging.ERROR)
        self._found = found

    def emit(self, record: logging.LogRecord) -> None:
        self._found.append(f"{record.getMessage()} {record.exc_info and record.exc_info[1]}")


def upload(page: Page, picture: Path) -> None:
    """Give the page a picture and wait until its ranked candidates are there and the asset is on show."""
    before = page.locator("#given").get_attribute("src")
    page.locator("#file").set_input_files(picture)
    expect(page.locator("#given")).not_to_have_attribute("src", before or "")
    page.wait_for_selector("#progress", state="visible")
    page.wait_for_selector("#progress", state="hidden")
    page.wait_for_selector("#candidates button[aria-pressed=true]")
    page.wait_for_selector("#viewer canvas[data-drawn]")


def seen(page: Page) -> str:
    """What the viewer shows when it has settled, as text that differs where the picture does."""
    page.wait_for_selector("body:not(.building)")
    page.wait_for_timeout(100)
    page.evaluate(TWO_FRAMES)
    return page.locator("#viewer canvas").get_attribute("data-drawn") or ""


def pixels(page: Page) -> tuple[float, float, float]:
    """The mean colour of the middle of the viewer."""
    canvas = load_image(page.locator("#viewer canvas").screenshot())
    height, width = canvas.shape[:2]
    middle = canvas[height * 4 // 9 : height * 5 // 9, width * 4 // 9 : width * 5 // 9, :3]
    red, green, blue = middle.reshape(-1, 3).mean(0)
    return float(red), float(green), float(blue)


def shown(page: Page, before: str) -> None:
    """Wait until the viewer shows another asset; its camera, which follows the size of the window, does not count."""
    number = before.split()[0]
    expect(page.locator("#viewer canvas")).not_to_have_attribute("data-drawn", re.compile(f"^{number} "))


def number(page: Page, name: str) -> Locator:
    return page.locator(f"[data-name={name}] input[type=number]")


def move(page: Page, name: str, value: float) -> None:
    number(page, name).fill(str(value))
    number(page, name).press("Enter")


def draw(page: Page, place: str, *points: tuple[float, float]) -> None:
    """A stroke with the mouse through points, as shares of an element's box."""
    box = page.locator(place).bounding_box()
    assert box
    x, y, wide, high = box["x"], box["y"], box["width"], box["height"]
    (right, down), *others = points
    page.mouse.move(x + right * wide, y + down * high)
    page.mouse.down()
    for right, down in others:
        page.mouse.move(x + right * wide, y + down * high, steps=8)
    page.mouse.up()


def downloaded(page: Page, ending: str, folder: Path) -> Path:
    page.locator("#format").select_option(ending)
    with page.expect_download() as waiting:
        page.locator("#download").click()
    target = folder / waiting.value.suggested_filename
    waiting.value.save_as(target)
    return target


def hold_back(page: Page, address: str, held: Callable[[str], bool]) -> Callable[[], None]:
    """Keep back the requests whose body `held` accepts, until the function that is returned is called."""
    waiting: list[Route] = []
    free = threading.Event()

    def handle(route: Route) -> None:
        if not free.is_set() and held(route.request.post_data or ""):
            waiting.append(route)
        else:
            route.continue_()

    def release() -> None:
        free.set()
        for route in waiting:
            with contextlib.suppress(Exception):
                route.continue_()

    page.route(address, handle)
    return release


def shoot(page: Page, name: str) -> None:
    SHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SHOTS / f"{name}.png", full_page=True)
