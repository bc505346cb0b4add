"""The page: what is on it, and which function answers each of its events."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gradio as gr

from dipcg.app import actions as actions
from dipcg.app.cutout import HOWS
from dipcg.app.events import Events
from dipcg.app.limits import telling, uploaded
from dipcg.app.service import Studio
from dipcg.app.session import Desk
from dipcg.app.viewer import data_url
from dipcg.images import load_image, over_white

FILES = Path(__file__).parent / "static"
EXAMPLES = (Path(__file__).parents[1] / "examples", Path(__file__).parents[3] / "examples" / "images")
BUILDS, ESTIMATES = 4, 2  # at once; more wait in the queue
CHOOSE = "let it choose"
MOST_LETTERS = 500  # of words
FORGET_S = 3 * 3600  # after which what a visitor left open is forgotten

ABOUT = """# dipcg
A photo, a sketch or a sentence becomes an **exact, light, editable** 3D asset: the parameters of a procedural
generator."""
EMPTY = {
    "strip": "Drop, paste or draw a picture, say what it is like, or take an example: candidates appear here, the "
    "likeliest first.",
    "viewer": "The asset opens here: drag to turn it, scroll to come nearer.",
    "parameters": "Every parameter of the asset appears here, and can be changed.",
}


class Page:
    """The components, in the context of a `gr.Blocks`, and which of `Events` answers each of their events."""

    def __init__(self, studio: Studio, downloads: Path) -> None:
        self.names, self.examples = studio.names, example_images(studio.names)
        self.desk = gr.State(Desk(), time_to_live=FORGET_S)
        self.turn = gr.Number(0, visible=False)  # counted by the page, see NEXT_TURN
        gr.Markdown(ABOUT, elem_id="about")
        with gr.Row(elem_id="columns"):
            with gr.Column(scale=4, min_width=300):
                self._picture_side()
            with gr.Column(scale=7, min_width=320):
                self._asset_side()
            with gr.Column(scale=5, min_width=320):
                self._parameter_side()
        self._connect(Events(studio, downloads, self.examples))

    def _picture_side(self) -> None:
        with gr.Tabs():
            with gr.Tab("Picture") as picture:
                self.picture = uploaded(
                    label="Photo, drawing or mask", sources=["upload", "clipboard", "webcam"], height=260,
                    show_label=False, elem_id="picture",
                )  # fmt: skip
            with gr.Tab("Draw") as drawing:
                self.sketch = _scripted("sketch", "sketch", "Draw the outline and the main edges.")
            with gr.Tab("Words") as words:
                self.words = gr.Textbox(
                    label="What it is like, in English", placeholder="a tall bar chair with arms and a slatted back",
                    lines=3, max_length=MOST_LETTERS, elem_id="words",
                )  # fmt: skip
                self.use_words = gr.Button("Make it", variant="primary", elem_id="use-words")
        for tab, asked in ((picture, "picture"), (drawing, "picture"), (words, "words")):
            tab.select(None, js=f"() => {{ document.body.dataset.asked = '{asked}' }}", api_visibility="private")
        self.offered = _scripted("strip", "examples", "Or start from one of these:" if self.examples else "")
        self.offered.value = self._offered()
        names = [(CHOOSE, ""), *((name, name) for name in self.names)]
        many = len(self.names) > 1
        self.generator = gr.Dropdown(
            names if many else names[1:], label="It shows a", visible=many, elem_id="generator"
        )
        self.cut_out = gr.Image(
            label="What the model sees", show_label=False, height=170, interactive=False, buttons=[], visible=False,
            elem_id="cut-out",
        )  # fmt: skip
        self.how_cut = gr.Markdown(elem_id="how-cut")
        with gr.Accordion("Correct the cut-out", open=False, visible=False, elem_id="correcting") as self.correcting:
            with gr.Row(elem_id="crop"):
                self.crop = [gr.Slider(0, 90, 0, step=1, label=f"Crop {side}, %", min_width=120) for side in SIDES]
            self.how = gr.Radio(list(HOWS), value="automatic", label="Cut out")
            self.difference = gr.Slider(2, 60, 14, step=1, label="Colour difference from the background", visible=False)
            with gr.Group(visible=False) as self.masking:
                self.mask = uploaded(label="Mask, light where the object is", height=160)
            self.use_cut = gr.Button("Estimate from this cut-out", size="sm")

    def _asset_side(self) -> None:
        self.strip = _scripted("strip", "candidates", EMPTY["strip"])
        self.viewer = _scripted("viewer", "viewer", EMPTY["viewer"])
        with gr.Row(elem_id="downloads"):
            self.format = gr.Dropdown(
                actions.endings(), value=".glb", label="Format", scale=2, min_width=110, elem_id="format"
            )
            self.detail = gr.Dropdown(["full", "light"], value="full", label="Detail", scale=2, min_width=110)
            self.download = gr.Button("Download", variant="primary", scale=3, min_width=150, elem_id="download")
        self.file = gr.File(label="Your file", visible=False, interactive=False, elem_id="file")
        with gr.Accordion("The command that makes it again", open=False):
            self.command = _scripted("command", "command", "It appears here when an asset is open.")

    def _parameter_side(self) -> None:
        with gr.Row(elem_id="edits"):
            self.undo = gr.Button("Undo", size="sm", min_width=60)
            self.reset = gr.Button("Reset", size="sm", min_width=60)
            self.random = gr.Button("Random", size="sm", min_width=60)
            self.again = gr.Button("Estimate the rest again", size="sm", min_width=150)
        self.panel = _scripted("parameters", "parameters", EMPTY["parameters"])

    def _offered(self) -> dict[str, Any] | None:
        tiles = [
            {"image": data_url(over_white(load_image(path))[::2, ::2]), "label": path.stem, "description": "Example"}
            for path in self.examples
        ]
        return {"candidates": tiles, "chosen": -1} if tiles else None

    def _connect(self, does: Events) -> None:
        asked, corrections = [self.desk, self.turn], [self.how, self.difference, self.mask, *self.crop]
        looks = [self.picture, *corrections]
        looked = [self.cut_out, self.how_cut, self.correcting, self.difference, self.masking]
        found = [self.desk, self.strip, *self._asset()[1:]]
        estimating: dict[str, Any] = {
            "inputs": [*asked, self.generator, *looks], "outputs": found, "show_progress_on": [self.strip],
            "concurrency_id": "estimate", "concurrency_limit": ESTIMATES, "api_visibility": "private",
            "trigger_mode": "multiple", "js": NEXT_TURN,
        }  # fmt: skip
        again: dict[str, Any] = estimating | {"inputs": asked}
        saying: dict[str, Any] = estimating | {"inputs": [*asked, self.generator, self.words]}
        looking: dict[str, Any] = QUIET | {"trigger_mode": "multiple"}
        self.picture.change(None, None, self.crop, js="() => [0, 0, 0, 0]", **looking).then(
            telling(does.look), looks, looked, **looking
        ).success(telling(does.estimate), **estimating)
        for control in corrections:
            control.change(telling(does.look), looks, looked, **QUIET)
        self.use_cut.click(telling(does.estimate), **estimating)
        self.generator.input(telling(does.estimate), **estimating)
        self.again.click(telling(does.estimate_again), **again)
        self.use_words.click(telling(does.describe), **saying)
        self.words.submit(telling(does.describe), **saying)
        self.sketch.select(telling(does.sketched), None, self.picture, **QUIET)
        self.offered.select(telling(does.example), None, self.picture, **QUIET)
        self._edits(does)
        self.download.click(
            telling(does.write), [self.desk, self.format, self.detail], self.file,
            show_progress_on=self.download, api_visibility="private",
        ).success(None, js=SAVE, api_visibility="private")  # fmt: skip

    def _edits(self, does: Events) -> None:
        """Every event counts, and none waits for another: the desk puts them into the order of asking."""
        asked, asset = [self.desk, self.turn], self._asset()
        edits: dict[str, Any] = {"trigger_mode": "multiple", "concurrency_limit": None, "js": NEXT_TURN, **QUIET}
        self.strip.select(telling(does.open), asked, asset, **edits)
        self.panel.input(telling(does.edit), asked, asset, **edits)
        self.panel.select(telling(does.hold), asked, [self.desk, self.panel], **edits)
        self.undo.click(telling(does.undo), asked, asset, **edits)
        self.reset.click(telling(does.reset), asked, asset, **edits)
        self.random.click(telling(does.draw_at_random), [*asked, self.generator], asset, **edits)

    def _asset(self) -> list[Any]:
        return [self.desk, self.viewer, self.panel, self.command]


ALSO_CHAIRS = {"armchair": "chair", "sketch": "chair"}  # the other pictures are named after their generators
SIDES = ("left", "right", "top", "bottom")
QUIET: dict[str, Any] = {"api_visibility": "private", "show_progress": "hidden"}
SHEET = (
    '<canvas width="512" height="512" aria-label="Sheet to draw on"></canvas>'
    '<button type="button" class="use">Use the sketch</button><button type="button" class="clear">Clear</button>'
)
TURNING = "The asset in 3D; arrow keys turn it, plus and minus zoom"
NEXT_TURN = "(desk, turn, ...given) => [desk, (window.dipcgTurn = (window.dipcgTurn ?? 0) + 1), ...given]"
SAVE = "() => setTimeout(() => document.querySelector('#file a[download]')?.click(), 300)"


def example_images(names: list[str]) -> list[Path]:
    """The pictures that ship of these generators: beside the package when installed, in examples/ of a checkout."""
    found = next((found for folder in EXAMPLES if (found := sorted(folder.glob("*.png")))), [])
    return [path for path in found if ALSO_CHAIRS.get(path.stem, path.stem) in names]


def _scripted(script: str, name: str, empty: str) -> gr.HTML:
    """A component of our own: its elements, and a script of page/ that fills them with the value."""
    inside = {
        "command": '<pre tabindex="0"></pre><button type="button" class="copy">Copy</button>',
        "strip": f'<div class="strip" role="group" aria-label="{name}"></div><p class="note"></p>',
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
