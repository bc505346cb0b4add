"""The web app: a picture in, candidates, every parameter to edit, files out. One page of Gradio over app_actions."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gradio as gr
from starlette.middleware import Middleware

from dipcg.app.api import add_api
from dipcg.app.limits import MOST_BYTES, WAITING, BodyLimit, fetch_no_addresses
from dipcg.app.page import BUILDS, FILES, Page
from dipcg.app.service import Studio


def serve(names: Sequence[str], host: str, port: int, workers: int | None, browser: bool) -> None:
    """Serve the page until Ctrl-C; files of visitors live in a folder that is deleted at the end."""
    with tempfile.TemporaryDirectory(prefix="dipcg-") as folder, Studio(names, workers) as studio:
        page = build_page(studio, Path(folder))
        launch(page, host, port, inbrowser=browser)


def launch(page: gr.Blocks, host: str = "127.0.0.1", port: int | None = None, **settings: Any) -> str:
    """Start the server of a page, bounded in what it takes; returns its address."""
    _, address, _ = page.launch(
        server_name=host, server_port=port, show_error=True, max_file_size=MOST_BYTES, share=False, ssr_mode=False,
        state_session_capacity=WAITING, css_paths=FILES / "page.css", theme=_theme(), footer_links=["api"],
        app_kwargs={"middleware": [Middleware(BodyLimit)]}, **settings,
    )  # fmt: skip
    return address


def build_page(studio: Studio, folder: Path) -> gr.Blocks:
    """The page and its HTTP API; `folder` is where uploads and downloads go."""
    fetch_no_addresses()
    os.environ["GRADIO_TEMP_DIR"] = str(folder / "uploads")
    downloads = folder / "downloads"
    downloads.mkdir(parents=True, exist_ok=True)
    with gr.Blocks(title="dipcg", analytics_enabled=False, delete_cache=(600, 3600), fill_width=True) as page:
        add_api(studio, downloads)  # first, since Gradio gives a name to the first that asks, private or not
        Page(studio, downloads)
    return page.queue(max_size=WAITING, default_concurrency_limit=BUILDS)


def _theme() -> gr.themes.Base:
    """Gradio's plain theme with the system's fonts, so that nothing is fetched from elsewhere."""
    fonts = ("ui-sans-serif", "system-ui", "sans-serif")
    theme = gr.themes.Base(
        primary_hue="amber", neutral_hue="stone", font=fonts, font_mono=("ui-monospace", "monospace")
    )
    return theme.set(block_border_width="0px", body_background_fill="#faf9f7", block_background_fill="transparent")
