"""The web server: the API and the static page over uvicorn."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import signal
import sys
import tempfile
import webbrowser
from collections.abc import AsyncIterator, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import uvicorn
from fastapi import FastAPI
from fastapi.staticfiles import StaticFiles

import dipcg
from dipcg.app import training_routes
from dipcg.app.desk import Desk
from dipcg.app.errors import add_error_handlers
from dipcg.app.guard import Guard
from dipcg.app.limits import MOST_JSON_BYTES
from dipcg.app.protocol import TimedProtocol
from dipcg.app.routes import router
from dipcg.app.studio import Studio
from dipcg.importing.program import check_program

STATIC = Path(__file__).parent / "static"
# From glibc's malloc.h.
M_MMAP_THRESHOLD = -3
# Seconds that requests have to end after Ctrl-C or SIGTERM.
LAST_S = 3
# The server sends nothing to anybody but its clients.
SILENT: Any = {"tracing": False, "metrics": False, "logs": False, "auto_configure": False}


def serve(
    names: Sequence[str],
    host: str,
    port: int,
    workers: int | None,
    browser: bool,
    allow_hosts: Sequence[str] = (),
    learn: Path | None = None,
    blender: str = "",
) -> None:
    """Serve until Ctrl-C or SIGTERM; files of visitors live in a folder that is deleted at the end.

    `learn` is the folder of generators that are learned, which stays; `blender` is another Blender for files that are
    too new for ours. Raises ValueError with a sentence for a program that is none.
    """
    program = learning_program(blender, learn)
    give_memory_back()
    address = f"http://{host}:{port}"
    # uvicorn ends with the signal that stopped it, which without this would end the process before it has cleaned up.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with temporary_folder() as folder, Studio(names, workers) as studio:
        print(f"The page is at {address}, the API's description at {address}/docs; Ctrl-C stops the server.")
        if browser:
            webbrowser.open(address)
        with contextlib.suppress(KeyboardInterrupt):
            uvicorn.run(**settings(make_app(studio, folder, {host, *allow_hosts}, learn, program), host, port))


def learning_program(blender: str, learn: Path | None) -> str:
    """The full path of another Blender, if one is given; raises ValueError with a sentence."""
    if blender and learn is None:
        raise ValueError("--blender is for generators that are learned; give their folder too, with --learn FOLDER.")
    return check_program(blender) if blender else ""


def give_memory_back() -> None:
    """Let glibc return large blocks when they are freed; else those of one picture stay while the next is decoded."""
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, 2**20)


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder for files of visitors, which is deleted at the end."""
    with tempfile.TemporaryDirectory(prefix="dipcg-", ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def settings(app: Any, host: str, port: int) -> dict[str, Any]:
    """How uvicorn runs an application."""
    return {
        "app": app, "host": host, "port": port, "http": TimedProtocol, "ws": "none", "loop": "asyncio",
        "log_level": "warning", "access_log": False, "server_header": False,
        "timeout_graceful_shutdown": LAST_S, "h11_max_incomplete_event_size": 16 * 1024,
    }  # fmt: skip


def make_app(
    studio: Studio, folder: Path, hosts: Collection[str] = (), learn: Path | None = None, blender: str = ""
) -> Guard:
    """The application; `folder` is where files of visitors go, `hosts` are names under which it answers.

    `learn` is the folder of generators that are learned, None for none; `blender` is a program that reads newer files.
    """

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        app.state.desk = desk = Desk(studio, folder, learn, blender)
        sweeping = asyncio.create_task(desk.sweep_for_ever())
        yield
        sweeping.cancel()
        await asyncio.to_thread(desk.close)

    app = FastAPI(
        title="dipcg", version=dipcg.__version__, docs_url=None, redoc_url=None, lifespan=lifespan,
        max_body_size=MOST_JSON_BYTES, telemetry=SILENT,
    )  # fmt: skip
    add_error_handlers(app)
    app.include_router(router)
    app.include_router(training_routes.router)
    app.mount("/", StaticFiles(directory=STATIC, html=True))
    return Guard(app, hosts)
