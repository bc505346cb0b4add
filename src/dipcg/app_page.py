"""The page: what is on it, and which action each of its events calls."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gradio as gr
import numpy as np

from dipcg import app_actions as actions
from dipcg import app_work
from dipcg.app_cutout import HOWS, Correction, corrected, shown
from dipcg.app_limits import sentence, telling, uploaded
from dipcg.app_parameters import rows
from dipcg.app_studio import Studio
from dipcg.app_viewer import data_url
from dipcg.app_work import Work
from dipcg.images import load_image, over_white

FILES = Path(__file__).parent / "page"
EXAMPLES = (Path(__file__).parent / "examples", Path(__file__).parents[2] / "examples" / "images")
BUILDS, ESTIMATES = 4, 2  # at once; more wait in the queue
CHOOSE = "let it choose"
FORGET_S = 3 * 3600  # after which what a visitor left open is forgotten

ABOUT = """# dipcg
A photo or a sketch becomes an **exact, light, editable** 3D asset: the parameters of a procedural generator."""
EMPTY = {
    "strip": "Drop, paste or draw a picture, or take an example: candidates appear here, the likeliest first.",
    "viewer": "The asset opens here: drag to turn it, scroll to come nearer.",
    "parameters": "Every parameter of the asset appears here, and can be changed.",
}


class Page:
    """The components, in the context of a `gr.Blocks`; events carry plain values and work on a copy of `Work`."""

    def __init__(self, studio: Studio, downloads: Path) -> None:
        self.studio, self.downloads, self.examples = studio, downloads, example_images()
        self.work = gr.State(Work(), time_to_live=FORGET_S)
        gr.Markdown(ABOUT, elem_id="about")
        with gr.Row(elem_id="columns"):
            with gr.Column(scale=4, min_width=300):
                self._picture_side()
            with gr.Column(scale=7, min_width=320):
                self._asset_side()
            with gr.Column(scale=5, min_width=320):
                self._parameter_side()
        self._connect()

    def _picture_side(self) -> None:
        with gr.Tabs():
            with gr.Tab("Picture"):
                self.picture = uploaded(
                    label="Photo, drawing or mask", sources=["upload", "clipboard", "webcam"], height=260,
                    elem_id="picture",
                )  # fmt: skip
            with gr.Tab("Draw"):
                self.sketch = _scripted("sketch", "sketch", "Draw the outline and the main edges.")
        self.offered = _scripted("strip", "examples", "Or start from one of these:" if self.examples else "")
        self.offered.value = self._offered()
        names = [(CHOOSE, ""), *((name, name) for name in self.studio.names)]
        many = len(self.studio.names) > 1
        self.generator = gr.Dropdown(
            names if many else names[1:], label="It shows a", visible=many, elem_id="generator"
        )
        self.cut_out = gr.Image(label="What the model sees", height=170, interactive=False, buttons=[], visible=False)
        self.how_cut = gr.Markdown(elem_id="how-cut")
        with gr.Accordion("Correct the cut-out", open=False, visible=False) as self.correcting:
            self.how = gr.Radio(list(HOWS), value="automatic", label="Cut out")
            self.difference = gr.Slider(2, 60, 14, step=1, label="Colour difference from the background", visible=False)
            with gr.Group(visible=False) as self.masking:
                self.mask = uploaded(label="Mask, light where the object is", height=160)
            self.use_cut = gr.Button("Estimate from this cut-out")

    def _asset_side(self) -> None:
        self.strip = _scripted("strip", "candidates", EMPTY["strip"])
        self.note = gr.Markdown(elem_id="note")
        self.viewer = _scripted("viewer", "viewer", EMPTY["viewer"])
        with gr.Row(elem_id="downloads"):
            self.format = gr.Dropdown(
                actions.endings(), value=".glb", label="Format", scale=2, min_width=110, elem_id="format"
            )
            self.detail = gr.Dropdown(["full", "light"], value="full", label="Detail", scale=2, min_width=110)
            self.download = gr.Button("Download", variant="primary", scale=3, min_width=150, elem_id="download")
        self.file = gr.File(label="Your file", visible=False, interactive=False, elem_id="file")
        with gr.Accordion("The command that makes it again", open=False):
            self.command = gr.Code(
                language="shell", show_label=False, interactive=False, wrap_lines=True, elem_id="command"
            )

    def _parameter_side(self) -> None:
        with gr.Row(elem_id="edits"):
            self.undo = gr.Button("Undo", size="sm", min_width=70)
            self.reset = gr.Button("Reset", size="sm", min_width=70)
            self.random = gr.Button("Random", size="sm", min_width=70)
            self.again = gr.Button("Estimate the rest again", size="sm", min_width=160)
        self.panel = _scripted("parameters", "parameters", EMPTY["parameters"])

    def _connect(self) -> None:
        looks = [self.picture, self.how, self.difference, self.mask]
        looked = [self.cut_out, self.how_cut, self.correcting, self.difference, self.masking]
        asset = [self.work, self.viewer, self.panel, self.command]
        found = [self.strip, self.note, *asset]
        estimating: dict[str, Any] = {
            "inputs": [self.work, self.generator, *looks], "outputs": found, "show_progress_on": [self.strip],
            "concurrency_id": "estimate", "concurrency_limit": ESTIMATES, "api_visibility": "private",
        }  # fmt: skip
        again: dict[str, Any] = estimating | {"inputs": self.work}
        looking = {"api_visibility": "private", "show_progress_on": [self.strip]}
        self.picture.change(telling(self._look), looks, looked, **looking).success(
            telling(self._estimate), **estimating
        )
        for control in (self.how, self.difference, self.mask):
            control.change(telling(self._look), looks, looked, **QUIET)
        self.use_cut.click(telling(self._estimate), **estimating)
        self.generator.input(telling(self._estimate), **estimating)
        self.again.click(telling(self._estimate_again), **again)
        self.sketch.select(telling(self._sketched), None, self.picture, **QUIET)
        self.offered.select(telling(self._example), None, self.picture, **QUIET)
        self._edits(asset)
        self.download.click(
            telling(self._write), [self.work, self.format, self.detail], self.file,
            show_progress_on=self.download, api_visibility="private",
        ).success(None, js=SAVE, api_visibility="private")  # fmt: skip

    def _edits(self, asset: list[Any]) -> None:
        self.strip.select(telling(self._open), self.work, asset, **QUIET)
        one_by_one = {"trigger_mode": "multiple", "concurrency_limit": None, **QUIET}  # parameters.js waits for answers
        self.panel.input(telling(self._edit), self.work, asset, **one_by_one)
        self.panel.select(telling(self._hold), self.work, [self.work, self.panel], **QUIET)
        self.undo.click(telling(self._change(app_work.undone)), self.work, asset, **QUIET)
        self.reset.click(telling(self._change(app_work.reset)), self.work, asset, **QUIET)
        self.random.click(telling(self._random), [self.work, self.generator], [self.strip, self.note, *asset], **QUIET)

    def _look(self, picture: str | None, how: str, difference: float | int, mask: str | None) -> tuple[Any, ...]:
        if picture is None:
            nothing = gr.update(visible=False)
            return nothing, "", nothing, gr.skip(), gr.skip()
        asks_mask = how == "own mask" and mask is None
        cut, words = (None, "Add a mask.") if asks_mask else shown(_cut(picture, how, difference, mask))
        return (
            gr.update(value=cut, visible=True), words, gr.update(visible=True),
            gr.update(visible=how == "by colour"), gr.update(visible=how == "own mask"),
        )  # fmt: skip

    def _estimate(
        self, work: Work, generator: str, picture: str | None, how: str, difference: float | int, mask: str | None,
        progress: gr.Progress = gr.Progress(),  # noqa: B008
    ) -> tuple[Any, ...]:  # fmt: skip
        if picture is None:
            return (gr.skip(),) * 6
        return self._found(work, _cut(picture, how, difference, mask), generator or "", {}, 0, progress)

    def _estimate_again(self, work: Work, progress: gr.Progress = gr.Progress()) -> tuple[Any, ...]:  # noqa: B008
        if work.picture is None:
            raise sentence("Add a picture first: the parameters that are not held are estimated from it.")
        seed = int(np.random.default_rng().integers(1, 2**31))
        return self._found(work, work.picture, work.generator, app_work.to_keep(work), seed, progress)

    def _found(
        self, work: Work, picture: np.ndarray, generator: str, keep: Any, seed: int, progress: gr.Progress
    ) -> tuple[Any, ...]:
        def report(share: float, words: str) -> None:
            progress(share, desc=words)

        work, strip, words = actions.estimate(self.studio, work, picture, generator, keep, seed, report)
        return strip, words, *self._shown(work)

    def _open(self, work: Work, event: gr.EventData) -> tuple[Any, ...]:
        return self._shown(app_work.opened(work, int(event.index)))

    def _edit(self, work: Work, event: gr.EventData) -> tuple[Any, ...]:
        space = self._space(work)
        return self._shown(app_work.edited(work, space, str(event.name), event.value, bool(event.final)))

    def _hold(self, work: Work, event: gr.EventData) -> tuple[Any, ...]:
        work = app_work.held(work, self._space(work), str(event.name))
        return work, rows(self._space(work), work)

    def _change(self, change: Callable[[Work], Work]) -> Callable[[Work], tuple[Any, ...]]:
        def changed(work: Work) -> tuple[Any, ...]:
            return self._shown(change(work)) if work.params else (gr.skip(),) * 4

        return changed

    def _random(self, work: Work, generator: str) -> tuple[Any, ...]:
        name = work.generator or generator or self.studio.names[0]
        space, rng = self.studio.find(name).generator.space, np.random.default_rng()
        new = app_work.drawn_at_random(work, name, space, rng)
        return gr.skip(), gr.skip(), *self._shown(new)

    def _write(self, work: Work, suffix: str, detail: str) -> Any:
        if not work.params:
            raise sentence("There is nothing to download yet: add a picture, or press Random.")
        made = actions.write(
            self.studio, self.downloads, work.generator, work.params, suffix, "light" if detail == "light" else "full"
        )
        return gr.update(value=str(made), visible=True)

    def _sketched(self, event: gr.EventData) -> np.ndarray:
        if not event.picture:
            raise sentence("The sketch is empty: draw the outline and the main edges first.")
        return over_white(load_image(base64.b64decode(str(event.picture).partition(",")[2])))

    def _example(self, event: gr.EventData) -> str:
        return str(self.examples[int(event.index)])

    def _offered(self) -> dict[str, Any] | None:
        tiles = [
            {"image": data_url(over_white(load_image(path))[::2, ::2]), "label": path.stem, "description": "Example"}
            for path in self.examples
        ]
        return {"candidates": tiles, "chosen": -1} if tiles else None

    def _shown(self, work: Work) -> tuple[Any, ...]:
        space = self._space(work)
        view = actions.view_of(self.studio, work)
        return work, view, rows(space, work), actions.command(self.studio, work)

    def _space(self, work: Work) -> Any:
        if not work.generator:
            raise sentence("Nothing is open yet: add a picture, or press Random.")
        return self.studio.find(work.generator).generator.space


QUIET: dict[str, Any] = {"api_visibility": "private", "show_progress": "hidden"}
SHEET = (
    '<canvas width="512" height="512" aria-label="Sheet to draw on"></canvas>'
    '<button type="button" class="use">Use the sketch</button><button type="button" class="clear">Clear</button>'
)
TURNING = "The asset in 3D; arrow keys turn it, plus and minus zoom"
SAVE = "() => setTimeout(() => document.querySelector('#file a[download]')?.click(), 300)"


def example_images() -> list[Path]:
    """The pictures that ship: beside the package when installed, in examples/ of a checkout."""
    return next((found for folder in EXAMPLES if (found := sorted(folder.glob("*.png")))), [])


def _cut(picture: str, how: str, difference: float | int, mask: str | None) -> np.ndarray:
    return corrected(picture, Correction(how, float(difference), mask))  # type: ignore[arg-type]


def _scripted(script: str, name: str, empty: str) -> gr.HTML:
    """A component of our own: its elements, and a script of page/ that fills them with the value."""
    inside = {
        "strip": f'<div class="strip" role="group" aria-label="{name}"></div>',
        "viewer": f'<canvas tabindex="0" hidden role="img" aria-label="{TURNING}"></canvas>',
        "parameters": '<div class="parameters"></div>',
        "sketch": SHEET,
    }[script]
    return gr.HTML(
        value=None,
        html_template=f'<p class="empty">{empty}</p>{inside}',
        js_on_load=(FILES / f"{script}.js").read_text(),
        apply_default_css=False,
        elem_id=name,
    )
