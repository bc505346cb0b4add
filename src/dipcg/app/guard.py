"""What every request passes first: who may ask, and how; and the headers that every answer has."""

from __future__ import annotations

import ipaddress
import json
from collections.abc import Awaitable, Callable, Collection, MutableMapping
from typing import Any
from urllib.parse import urlsplit

from dipcg.app.limits import MOST_DRAINED_BYTES, MOST_JSON_BYTES, MOST_PICTURE_BYTES, MOST_SOURCE_BYTES

Message = MutableMapping[str, Any]
Application = Callable[[Message, Callable[..., Any], Callable[..., Any]], Awaitable[None]]
Refusal = tuple[int, str]

# The only addresses that take long bodies, with the most bytes of each.
UPLOADS = {"/api/v1/pictures": MOST_PICTURE_BYTES, "/api/v1/trainings": MOST_SOURCE_BYTES}

# The page runs its own scripts alone, loads nothing from elsewhere, and is shown in no frame.
POLICY = "; ".join(
    [
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "media-src 'self' blob:",
        "connect-src 'self' blob:",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    ]
)
HEADERS = {
    "content-security-policy": POLICY,
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(self), microphone=(), geolocation=()",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}
ADDED = [(name.encode(), value.encode()) for name, value in HEADERS.items()]


class Guard:
    """ASGI middleware that refuses foreign hosts and origins, and bodies of unknown length.

    A host is allowed if it is an IP address, `localhost`, or one of `hosts`: a name of somebody else could be made to
    lead here (DNS rebinding), an address could not. An origin is allowed if it is the host itself or one of `hosts`.
    """

    def __init__(self, app: Application, hosts: Collection[str] = ()) -> None:
        self.app, self.hosts = app, {host.lower() for host in hosts}

    async def __call__(self, scope: Message, receive: Callable[..., Any], send: Callable[..., Any]) -> None:
        if scope["type"] == "lifespan":
            return await self.app(scope, receive, send)
        if scope["type"] != "http":
            return await send({"type": "websocket.close"})

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = {name for name, _ in message["headers"]}
                message["headers"] = [*message["headers"], *(pair for pair in ADDED if pair[0] not in own)]
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            return await self.app(scope, receive, send_with_headers)
        if refusal[0] == 413:
            await _drain(scope, receive)
        await refuse(send_with_headers, *refusal)

    def _refusal(self, scope: Message) -> Refusal | None:
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        host, origin = headers.get("host", ""), headers.get("origin")
        if not self._is_allowed_host(hostname(f"//{host}")):
            return 421, "This server does not answer to this host name; start it with --allow-host for the name."
        if origin is not None and not self._is_own_origin(origin, host):
            return 403, "Requests from other websites are refused."
        return body_refusal(headers) or length_refusal(headers, most_bytes(scope["method"], scope["path"]))

    def _is_allowed_host(self, name: str) -> bool:
        return name == "localhost" or name in self.hosts or is_address(name)

    def _is_own_origin(self, origin: str, host: str) -> bool:
        return origin.partition("://")[2].lower() == host.lower() or hostname(origin) in self.hosts


def body_refusal(headers: MutableMapping[str, str]) -> Refusal | None:
    """What is wrong with the way in which the length of a body is stated."""
    if "transfer-encoding" in headers:
        if "content-length" in headers:
            return 400, "Content-Length and Transfer-Encoding exclude each other."
        return 411, "State the length of the body (Content-Length); chunks are not read."
    if headers.get("content-encoding", "identity") != "identity":
        return 415, "Compressed bodies are not read."
    return None


def most_bytes(method: str, path: str) -> int:
    """The longest body of a request."""
    return UPLOADS.get(path, MOST_JSON_BYTES) if method == "POST" else MOST_JSON_BYTES


def length_refusal(headers: MutableMapping[str, str], most: int) -> Refusal | None:
    """What is wrong with the stated length of a body, which h11 takes for its end."""
    if int(headers.get("content-length", "0")) <= most:
        return None
    return 413, f"The request is too large: at most {most / 2**20:.2g} MB are read here."


def hostname(url: str) -> str:
    """The host of a URL in small letters; empty for none."""
    try:
        return (urlsplit(url).hostname or "").lower()
    except ValueError:
        return ""


def is_address(name: str) -> bool:
    """Whether this is an IP address and no name."""
    try:
        return bool(ipaddress.ip_address(name))
    except ValueError:
        return False


async def _drain(scope: Message, receive: Callable[..., Any]) -> None:
    """Read a body and forget it, if it is not very long: a client that is still sending does not see an answer."""
    left = int(dict(scope["headers"])[b"content-length"])
    while 0 < left <= MOST_DRAINED_BYTES:
        message = await receive()
        left -= len(message.get("body", b""))
        if not message.get("more_body", False):
            return


async def refuse(send: Callable[..., Any], status: int, sentence: str) -> None:
    """Answer with an error and close the connection, so that no body is read."""
    headers = [(b"content-type", b"application/json"), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": json.dumps({"error": sentence}).encode()})
