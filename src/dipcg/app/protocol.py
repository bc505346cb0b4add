"""uvicorn's protocol for HTTP/1.1 with the limits on slow clients that it lacks."""

from __future__ import annotations

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from dipcg.app.limits import BODY_BYTES_PER_S, BODY_S, HEADERS_S, MOST_CONNECTIONS, UNREAD_S


class TimedProtocol(H11Protocol):
    """Closes a connection whose request does not come in time, or whose client does not read the answer.

    The headers of a request have `HEADERS_S`, its body `BODY_S` and more by its stated length. When there are more than
    `MOST_CONNECTIONS`, the one that has waited longest for its request is closed.
    """

    deadline: asyncio.TimerHandle | None = None
    unread: asyncio.TimerHandle | None = None
    phase: Any = None
    since = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._make_room()
        self._watch()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        for timer in (self.deadline, self.unread):
            if timer:
                timer.cancel()
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        super().pause_writing()
        self.unread = self.loop.call_later(UNREAD_S, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        if self.unread:
            self.unread.cancel()

    @property
    def is_waiting(self) -> bool:
        """Whether a part of a request has still to come."""
        return self.phase in (h11.IDLE, h11.SEND_BODY)

    def _watch(self) -> None:
        """Set the deadline of what is waited for, when that is something else than before."""
        if self.phase is self.conn.their_state:
            return
        self.phase, self.since = self.conn.their_state, self.loop.time()
        if self.deadline:
            self.deadline.cancel()
        self.deadline = self.loop.call_later(self._patience_s(), self.transport.abort) if self.is_waiting else None

    def _patience_s(self) -> float:
        if self.phase is h11.IDLE:
            return HEADERS_S
        stated = dict(self.headers).get(b"content-length", b"0")
        return BODY_S + (int(stated) / BODY_BYTES_PER_S if stated.isdigit() else 0)

    def _make_room(self) -> None:
        if len(self.connections) <= MOST_CONNECTIONS:
            return
        waiting: list[Any] = [other for other in self.connections if getattr(other, "is_waiting", False)]
        longest = min(waiting, key=lambda other: other.since, default=self)
        longest.transport.abort()
