"""The command that starts the web app: serve."""

from __future__ import annotations

from tyro.conf import Positional


def serve(
    names: Positional[tuple[str, ...]] = (),
    /,
    *,
    host: str = "127.0.0.1",
    port: int = 7860,
    workers: int | None = None,
    browser: bool = False,
) -> None:
    """Start the web app: pictures in, editable assets out, with the same over HTTP.

    Args:
        names: of generators, or folders with checkpoints; all that ship when left out
        host: address to listen on; others can reach this machine only when you name one, as 0.0.0.0
        port: to listen on
        workers: build processes of each generator; as the processor allows when left out
        browser: open the page
    """
    try:
        from dipcg.app.server import serve as start
    except ModuleNotFoundError as error:
        if error.name != "gradio":
            raise
        raise ModuleNotFoundError("The web app needs Gradio: run `pip install 'dipcg[app]'`.") from None
    start(names, host, port, workers, browser)
