"""What keeps a server well with strangers: how much they may send, and what they are told when something fails."""

from __future__ import annotations

import functools
import html
import logging
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

import gradio as gr
from gradio import processing_utils
from PIL import Image

from dipcg.images import MAX_PIXELS

MOST_BYTES = 24 * 2**20  # of a picture
MOST_BODY_BYTES = MOST_BYTES + 2**20  # of a request
FAILED = "That did not work"
WAITING = 100  # requests in the queue, above which one is turned away

Scope = MutableMapping[str, Any]
Application = Callable[[Scope, Callable[..., Any], Callable[..., Any]], Awaitable[None]]


def uploaded(**settings: Any) -> gr.Image:
    """A picture that events get as the path of its upload: only `images.load_image` decodes it, having seen its size.

    No subclass: for one, Gradio would write a file beside this one. What is not a picture becomes a sentence.
    """
    image = gr.Image(type="filepath", image_mode=None, buttons=[], **settings)
    read = image.preprocess

    def preprocess(payload: Any) -> Any:
        try:
            return read(payload)
        except Image.DecompressionBombError:
            raise sentence(
                f"This picture is too large: at most {MAX_PIXELS / 1e6:.0f} million pixels are read."
            ) from None
        except Exception:
            raise sentence("This is not a picture in a known format; use PNG, JPEG or WebP.") from None

    image.preprocess = preprocess
    return image


def telling(work: Any) -> Any:
    """The same function, whose errors reach the visitor as sentences."""

    @functools.wraps(work)
    def told(*args: Any, **kwargs: Any) -> Any:
        try:
            return work(*args, **kwargs)
        except gr.Error:
            raise
        except (ValueError, LookupError, RuntimeError) as error:
            raise sentence(str(error)) from None
        except Exception as error:
            logging.exception("A visitor's request failed.")
            raise sentence(f"Something went wrong here ({type(error).__name__}); the server's log has more.") from None

    return told


def sentence(words: str) -> gr.Error:
    """An error that the page shows until it is closed."""
    return gr.Error(html.escape(words, quote=False), duration=None, title=FAILED, print_exception=False)


def fetch_no_addresses() -> None:
    """Let Gradio refuse addresses where it takes uploads; it would fetch them."""
    processing_utils.async_ssrf_protected_download = _refuse_address


class BodyLimit:
    """ASGI middleware that turns away requests whose body is too large or of unknown length, before it is read."""

    def __init__(self, app: Application, most_bytes: int = MOST_BODY_BYTES) -> None:
        self.app, self.most_bytes = app, most_bytes

    async def __call__(self, scope: Scope, receive: Callable[..., Any], send: Callable[..., Any]) -> None:
        problem = self._problem(scope)
        if problem is None:
            return await self.app(scope, receive, send)
        status, words = problem
        headers = [(b"content-type", b"application/json"), (b"connection", b"close")]
        await send({"type": "http.response.start", "status": status, "headers": headers})
        await send({"type": "http.response.body", "body": f'{{"detail": "{words}"}}'.encode()})

    def _problem(self, scope: Scope) -> tuple[int, str] | None:
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD", "OPTIONS"):
            return None
        headers = dict(scope["headers"])
        length = headers.get(b"content-length", b"")
        if not length.isdigit():
            return (411, "Requests must say how long they are.") if b"transfer-encoding" in headers else None
        if int(length) > self.most_bytes:
            return 413, f"At most {self.most_bytes / 2**20:.0f} MB can be sent."
        return None


async def _refuse_address(url: str, *_: object, **__: object) -> str:
    raise sentence("Upload the picture itself; addresses are not fetched.")
