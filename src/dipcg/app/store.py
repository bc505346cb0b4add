"""What visitors leave here, under ids that cannot be guessed, for a limited time and in a limited amount."""

from __future__ import annotations

import secrets
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import RLock
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass
class _Kept(Generic[T]):
    value: T
    size: int
    owner: str
    used: float = field(default_factory=time.monotonic)


class Store(Generic[T]):
    """Values by id; `drop` is called with each that goes.

    A value goes `lifetime_s` after its last use. Where an owner keeps more than `most_of_one`, its own oldest values
    go; where all together keep more than `most`, those of the owner who keeps the most.
    """

    def __init__(
        self, lifetime_s: float, most: int, most_of_one: int, drop: Callable[[T], None] = lambda value: None
    ) -> None:
        self._lifetime_s, self._most, self._most_of_one, self._drop = lifetime_s, most, most_of_one, drop
        self._kept: dict[str, _Kept[T]] = {}
        self._lock = RLock()

    def add(self, value: T, size: int, owner: str, name: str | None = None) -> str:
        """Keep a value; returns its id, which is `name` if that is given."""
        key = name or secrets.token_urlsafe(16)
        with self._lock:
            self.sweep()
            self._kept[key] = _Kept(value, size, owner)
            while (sizes := self._sizes())[owner] > self._most_of_one:
                self._remove_oldest(owner)
            while sum(sizes.values()) > self._most:
                self._remove_oldest(max(sizes, key=sizes.__getitem__))
                sizes = self._sizes()
        return key

    def get(self, key: str) -> T:
        """The value of an id, which counts as a use of it; raises KeyError."""
        with self._lock:
            self.sweep()
            kept = self._kept[key]
            kept.used = time.monotonic()
            return kept.value

    def remove(self, key: str) -> None:
        """Let a value go; nothing happens when it is gone."""
        with self._lock:
            if key in self._kept:
                self._drop(self._kept.pop(key).value)

    def sweep(self) -> None:
        """Let go what was not used for too long."""
        with self._lock:
            oldest = time.monotonic() - self._lifetime_s
            for key in [key for key, kept in self._kept.items() if kept.used < oldest]:
                self.remove(key)

    def __len__(self) -> int:
        return len(self._kept)

    def _sizes(self) -> dict[str, int]:
        sizes: dict[str, int] = defaultdict(int)
        for kept in self._kept.values():
            sizes[kept.owner] += kept.size
        return sizes

    def _remove_oldest(self, owner: str) -> None:
        own = {key: kept.used for key, kept in self._kept.items() if kept.owner == owner}
        self.remove(min(own, key=own.__getitem__))
