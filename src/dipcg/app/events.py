"""What each event of the page does: plain values in, what the components show out."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gradio as gr
import numpy as np

from dipcg.app import actions as actions
from dipcg.app import state as app_work
from dipcg.app.cutout import Correction, corrected, shown
from dipcg.app.limits import FAILED, sentence
from dipcg.app.panel import rows
from dipcg.app.service import Studio
from dipcg.app.session import Change, Desk
from dipcg.app.state import Asked, Work
from dipcg.images import load_image, over_white
from dipcg.workers.process import BuildError

Shown = tuple[Any, ...]


class Events:
    """The functions that the page's events call, each with the visitor's desk and the turn at which it was asked.

    Answers may overtake each other too: they carry numbers, and the page's scripts leave out what is older.
    """

    def __init__(self, studio: Studio, downloads: Path, examples: list[Path]) -> None:
        self.studio, self.downloads, self.examples = studio, downloads, examples

    def look(
        self, picture: str | None, how: str, difference: float | int, mask: str | None, *crop: float | int
    ) -> Shown:
        """The picture as the model will see it, how it was cut out, and which corrections can be made."""
        if picture is None:
            nothing = gr.update(visible=False)
            return nothing, "", nothing, gr.skip(), gr.skip()
        asks_mask = how == "own mask" and mask is None
        seen, words = (None, "Add a mask.") if asks_mask else shown(_cut(picture, how, difference, mask, *crop))
        told = words if asks_mask else f"What the model sees. {words}"
        return (
            gr.update(value=seen, visible=True), told, gr.update(visible=True),
            gr.update(visible=how == "by colour"), gr.update(visible=how == "own mask"),
        )  # fmt: skip

    def estimate(
        self, desk: Desk, turn: int, generator: str, progress: gr.Progress = gr.Progress(), *looks: Any  # noqa: B008
    ) -> Shown:  # fmt: skip
        """Candidates for the picture, the best open."""
        if looks[0] is None:
            return desk, *(gr.skip(),) * 4
        return self._found(desk, turn, _cut(*looks), generator or "", {}, 0, progress)

    def describe(
        self, desk: Desk, turn: int, generator: str, text: str, progress: gr.Progress = gr.Progress()  # noqa: B008
    ) -> Shown:  # fmt: skip
        """Candidates for what a sentence says, the expected one open."""
        return self._found(desk, turn, text or "", generator or "", {}, 0, progress)

    def estimate_again(self, desk: Desk, turn: int, progress: gr.Progress = gr.Progress()) -> Shown:  # noqa: B008
        """Candidates for the same picture or words around what is held."""
        work = desk.work
        if work.asked is None:
            raise sentence("Add a picture or words first: the parameters that are not held are estimated from them.")
        return self._found(desk, turn, work.asked, work.generator, app_work.to_keep(work), _seed(), progress)

    def open(self, desk: Desk, turn: int, event: gr.EventData) -> Shown:
        """One of the candidates."""
        index = int(event.index)
        return self._changed(desk, turn, lambda work: app_work.opened(work, index))

    def edit(self, desk: Desk, turn: int, event: gr.EventData) -> Shown:
        """One parameter changed."""
        name, value, final = str(event.name), event.value, bool(event.final)
        return self._changed(desk, turn, lambda work: app_work.edited(work, self._space(work), name, value, final))

    def hold(self, desk: Desk, turn: int, event: gr.EventData) -> Shown:
        """One parameter held, or let go."""
        name = str(event.name)
        version, work = desk.change(turn, lambda work: app_work.held(work, self._space(work), name))
        return desk, self._panel(work, version)

    def undo(self, desk: Desk, turn: int) -> Shown:
        """The last edit taken back."""
        return self._changed(desk, turn, app_work.undone)

    def reset(self, desk: Desk, turn: int) -> Shown:
        """The asset as it was opened."""
        return self._changed(desk, turn, app_work.reset)

    def draw_at_random(self, desk: Desk, turn: int, generator: str) -> Shown:
        """Random parameters, those that are held kept."""
        seed = _seed()

        def change(work: Work) -> Work:
            name = work.generator or generator or self.studio.names[0]
            space = self.studio.find(name).generator.space
            return app_work.drawn_at_random(work, name, space, np.random.default_rng(seed))

        return self._changed(desk, turn, change)

    def write(self, desk: Desk, suffix: str, detail: str) -> Any:
        """The open asset as a file."""
        work = desk.work
        if not work.params:
            raise sentence("There is nothing to download yet: add a picture, or press Random.")
        made = actions.write(
            self.studio, self.downloads, work.generator, work.params, suffix, "light" if detail == "light" else "full"
        )
        return gr.update(value=str(made), visible=True)

    def sketched(self, event: gr.EventData) -> np.ndarray:
        """The drawing as a picture."""
        if not event.picture:
            raise sentence("The sketch is empty: draw the outline and the main edges first.")
        return over_white(load_image(base64.b64decode(str(event.picture).partition(",")[2])))

    def example(self, event: gr.EventData) -> str:
        """One of the pictures that ship."""
        return str(self.examples[int(event.index)])

    def _found(
        self, desk: Desk, turn: int, asked: Asked, generator: str, keep: Mapping[str, Any], seed: int,
        progress: gr.Progress,
    ) -> Shown:  # fmt: skip
        def report(share: float, words: str) -> None:
            progress(share, desc=words)

        change, strip = actions.estimate(self.studio, asked, generator, keep, seed, report)
        desk, *asset = self._changed(desk, turn, change)
        return desk, strip | {"chosen": max(0, desk.work.chosen), "version": turn}, *asset

    def _changed(self, desk: Desk, turn: int, change: Change) -> Shown:
        """The desk after a change with what shows it; what cannot be built is told, and the change can be undone."""
        version, work = desk.change(turn, change)
        command = {"text": actions.command(self.studio, work), "version": version}
        return desk, self._view(desk, work, version), self._panel(work, version), command

    def _view(self, desk: Desk, work: Work, version: int) -> Any:
        if desk.work.params != work.params:  # a later change has an answer of its own
            return gr.skip()
        try:
            view = actions.view_of(self.studio, work)
        except BuildError as error:
            gr.Warning(html.escape(str(error), quote=False), duration=None, title=FAILED)
            return gr.skip()
        return view and view | {"version": version}

    def _panel(self, work: Work, version: int) -> dict[str, Any]:
        parts = rows(self._space(work), work) if work.params else []
        return {"parts": parts, "version": version}

    def _space(self, work: Work) -> Any:
        if not work.generator:
            raise sentence("Nothing is open yet: add a picture, or press Random.")
        return self.studio.find(work.generator).generator.space


def _cut(picture: str, how: str, difference: float | int, mask: str | None, *crop: float | int) -> np.ndarray:
    left, right, top, bottom = (share / 100 for share in crop)
    return corrected(picture, Correction(how, float(difference), mask, (left, right, top, bottom)))  # type: ignore[arg-type]


def _seed() -> int:
    return int(np.random.default_rng().integers(1, 2**31))
