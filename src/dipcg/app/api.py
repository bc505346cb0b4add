"""The same actions over HTTP, for programs: named endpoints without a session (docs/app.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gradio as gr
import numpy as np

from dipcg.app import actions as actions
from dipcg.app.limits import telling, uploaded
from dipcg.app.page import BUILDS, ESTIMATES
from dipcg.app.service import CANDIDATES, Studio


def add_api(studio: Studio, downloads: Path) -> None:
    """Add the endpoints /generators, /cut_out, /estimate, /describe and /build to the `gr.Blocks` of the context."""

    def generators() -> list[dict[str, Any]]:
        """The generators with their parameters."""
        return actions.answer_generators(studio)

    def cut_out(picture: str, difference: float | int | None) -> np.ndarray:
        """The object cut out; `difference` from the background's colour in CIELAB, or null."""
        return actions.answer_cut_out(_given(picture), difference)

    def estimate(picture: str, generator: str, candidates: float | int, seed: float | int, keep: Any) -> dict[str, Any]:
        """Candidates for a picture; an empty generator lets it choose, `keep` holds parameters."""
        return actions.answer_estimate(studio, _given(picture), generator or "", int(candidates), int(seed), keep)

    def describe(text: str, generator: str, candidates: float | int, seed: float | int, keep: Any) -> dict[str, Any]:
        """Candidates for a sentence, as /estimate gives them for a picture."""
        return actions.answer_describe(studio, text or "", generator or "", int(candidates), int(seed), keep)

    def build(generator: str, params: Any, format: str, light: bool) -> str:
        """A file of an asset: its mesh in one of the formats, or its parameters."""
        return str(actions.write(studio, downloads, generator, params, format, "light" if light else "full"))

    with gr.Row(visible=False):
        trigger, picture, answer = gr.Button(), uploaded(), gr.JSON()
        generator, text = gr.Textbox("", label="generator"), gr.Textbox("", label="text")
        params, keep = gr.JSON(label="params"), gr.JSON({}, label="keep")
        candidates, seed = gr.Number(CANDIDATES, label="candidates"), gr.Number(0, label="seed")
        difference, light = gr.Number(None, label="difference"), gr.Checkbox(label="light")
        ending = gr.Textbox(".glb", label="format")
        trigger.click(telling(generators), [], answer, api_name="generators")
        trigger.click(telling(cut_out), [picture, difference], gr.Image(format="png"), api_name="cut_out")
        trigger.click(
            telling(estimate), [picture, generator, candidates, seed, keep], answer,
            api_name="estimate", concurrency_id="estimate", concurrency_limit=ESTIMATES,
        )  # fmt: skip
        trigger.click(
            telling(describe), [text, generator, candidates, seed, keep], answer,
            api_name="describe", concurrency_id="estimate", concurrency_limit=ESTIMATES,
        )  # fmt: skip
        trigger.click(
            telling(build), [generator, params, ending, light], gr.File(), api_name="build", concurrency_limit=BUILDS
        )


def _given(picture: str | None) -> str:
    if picture is None:
        raise ValueError("Give a picture.")
    return picture
