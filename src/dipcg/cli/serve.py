"""The command that starts the web app: serve."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional


def serve(
    names: Positional[tuple[str, ...]] = (),
    /,
    *,
    host: str = "127.0.0.1",
    port: int = 7860,
    workers: int | None = None,
    browser: bool = False,
    allow_host: tuple[str, ...] = (),
    learn: Path | None = None,
    blender: str = "",
) -> None:
    """Start the web app, in which pictures become editable assets, and its HTTP API.

    Args:
        names: names of generators, or folders with checkpoints; all that ship when left out
        host: address to listen on; other machines can connect only to an address like 0.0.0.0
        port: port to listen on
        workers: number of build processes of each generator; by the number of processors when left out
        browser: open the page
        allow_host: names under which the server may be asked, besides localhost; give the name of your proxy
        learn: folder in which generators that visitors send are learned; none are when left out. With --allow-code
            FOLDER for the same folder, Python files are taken too, and run with all your rights
        blender: another Blender, or a Python that has bpy, which reads files that are too new for ours
    """
    try:
        from dipcg.app.server import serve as start
    except ModuleNotFoundError as error:
        if error.name not in ("fastapi", "uvicorn"):
            raise
        raise ModuleNotFoundError("The web app needs FastAPI and uvicorn: run `pip install 'dipcg[app]'`.") from None
    start(names, host, port, workers, browser, allow_host, learn, blender)
