"""Recording the random draws of a program and replaying them: `install` once, then `Recorder` around each run."""

from __future__ import annotations

import functools
import os
import random
import sys
import threading
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import CodeType, FrameType
from typing import Any

import numpy as np

from dipcg.tracing.distributions import Distribution, Setting, distribution, share_of, value_of
from dipcg.tracing.sites import Site, places, site

# A program that draws more often than this in one run is refused.
MAX_DRAWS = 5000
# Draws of one site that get a parameter each; later ones share one.
MAX_REPEATS = 4
# Values of a larger array are noise rather than parameters.
MAX_ARRAY = 8
# Methods of random number generators that do not draw.
QUIET = ("seed", "get_state", "set_state", "getstate", "setstate", "spawn", "bit_generator", "VERSION")
# Functions of `random` whose arguments mean something else than those of NumPy's function of the same name.
DIFFERENT = ("random", "uniform", "randint", "randrange", "choice", "triangular")


class ProgramError(ValueError):
    """A program cannot be recorded; the message says why."""


@dataclass
class Draw:
    """One recorded draw: its site, how many came from there before it, from what, and its value."""

    site: Site
    nth: int
    of: Distribution
    value: Any
    thresholds: set[float] = field(default_factory=set)
    repeats: bool = False
    """Whether the program had set its seed again and drew the same number again"""


class Watched(float):
    """A drawn number that notes what it is compared with."""

    thresholds: set[float]

    def _note(self, other: Any) -> Any:
        if isinstance(other, (int, float, np.floating, np.integer)):
            self.thresholds.add(float(other))
        return other

    def __lt__(self, other: Any) -> bool:
        return float(self) < self._note(other)

    def __le__(self, other: Any) -> bool:
        return float(self) <= self._note(other)

    def __gt__(self, other: Any) -> bool:
        return float(self) > self._note(other)

    def __ge__(self, other: Any) -> bool:
        return float(self) >= self._note(other)

    __eq__ = float.__eq__
    __hash__ = float.__hash__


# The value of a draw that is a parameter, from its key, its number, and what it draws from; None for one that is not.
Choose = Callable[[Site, int, int, Distribution], Any]


class Recorder:
    """Records the draws of one run of a program and puts chosen values in their place; a context manager.

    `choose(site, nth, component, distribution)` returns the value of a draw, or None where its site decides.
    """

    active: Recorder | None = None

    def __init__(self, seed: int, choose: Choose, stop: CodeType) -> None:
        self.seed, self.choose, self.stop = seed, choose, stop
        self.draws: list[Draw] = []
        self.inside = False
        self._counts: Counter[str] = Counter()
        self._seen: dict[tuple, Draw] = {}

    def __enter__(self) -> Recorder:
        install()
        np.random.seed(self.seed)
        random.seed(self.seed)
        Recorder.active = self
        return self

    def __exit__(self, *_: object) -> None:
        Recorder.active = None

    def draw(self, method: str, call: Callable[..., Any], again: Callable[..., Any], state: int, args: Any) -> Any:
        """The value of a draw in place of what the generator gave; `again` draws from a fresh generator."""
        if len(self.draws) >= MAX_DRAWS:
            raise ProgramError(f"It draws more than {MAX_DRAWS:,} times, too many for parameters.")
        frame = _frame_outside()
        where = site(places(frame, self.stop))
        of = distribution(method, *args)
        # A program that sets the same seed again wants the same numbers again.
        same = (state, method, where.line, repr(args))
        if same in self._seen:
            first = self._seen[same]
            self.draws.append(Draw(first.site, first.nth, of, first.value, first.thresholds, repeats=True))
            return first.value
        self._counts[where.key] += 1
        nth = self._counts[where.key]
        value = self._value(where, nth, of, again, args)
        drawn = Draw(where, nth, of, value)
        if isinstance(value, float) and where.compared:
            drawn.value = value = Watched(value)
            value.thresholds = drawn.thresholds
        self.draws.append(drawn)
        self._seen[same] = drawn
        return value

    def _value(self, where: Site, nth: int, of: Distribution, again: Callable[..., Any], args: Any) -> Any:
        fresh = again(zlib.crc32(f"{self.seed} {where.key} {nth}".encode()), *args)
        if of.kind == "other" or (of.size or 0) > MAX_ARRAY:
            return fresh
        if of.size is None:
            chosen = self.choose(where, nth, 0, of)
            return fresh if chosen is None else chosen
        values = np.array(fresh)
        for index in range(of.size):
            chosen = self.choose(where, nth, index, of)
            if chosen is not None:
                values.reshape(-1)[index] = chosen
        return values


def chosen(values: Mapping[str, Setting]) -> Choose:
    """The values of draws by their address; those without an entry are left to their sites."""

    def choose(where: Site, nth: int, index: int, of: Distribution) -> Any:
        setting = values.get(address(where, nth, index))
        return None if setting is None else value_of(of, index, setting)

    return choose


def explored(seed: int, values: Mapping[str, Setting], shares: dict[str, float]) -> Choose:
    """As `chosen`, with a random share of its range for every other draw; `shares` receives the share of each."""

    def choose(where: Site, nth: int, index: int, of: Distribution) -> Any:
        here = address(where, nth, index)
        random_share = zlib.crc32(f"{seed} {here}".encode()) / 2**32
        setting = values.get(here) or ("share", random_share)
        shares[here] = share_of(of, index, setting)
        return value_of(of, index, setting)

    return choose


def address(where: Site, nth: int, index: int) -> str:
    """How a parameter names its draw: the site, the number of the draw there, and the component.

    Draws of a site beyond the limit have one name, with the number 0, except where a loop may draw until it likes the
    value: with one value for all, it might never end.
    """
    beyond = nth > MAX_REPEATS and not where.retried
    return f"{where.key} {0 if beyond else nth} {index}"


@functools.cache
def install() -> None:
    """Put recording functions in place of those of `numpy.random` and `random`, in this process, for good.

    It must run before the program is imported, because `from numpy.random import uniform` keeps what it finds.
    """
    # The RandomState behind the functions of `numpy.random`.
    legacy, rng = np.random.get_state.__self__, np.random.default_rng

    class RecordedState(np.random.RandomState):
        """A RandomState whose draws are recorded."""

    class RecordedGenerator(np.random.Generator):
        """A Generator whose draws are recorded."""

    class RecordedRandom(random.Random):
        """A `random.Random` whose draws are recorded."""

    for name in _drawing(np.random.RandomState):
        setattr(np.random, name, _recorded(name, getattr(legacy, name), _fresh_state(name), _state_of(legacy)))
        setattr(RecordedState, name, _recorded_method(name, np.random.RandomState, _fresh_state(name)))
    for name in _drawing(np.random.Generator):
        setattr(RecordedGenerator, name, _recorded_method(name, np.random.Generator, _fresh_generator(name)))
    instance = random._inst
    for name in _drawing(random.Random):
        label = f"random.{name}" if name in DIFFERENT else name
        setattr(random, name, _recorded(label, getattr(instance, name), _fresh_random(name), _state_of(instance)))
        setattr(RecordedRandom, name, _recorded_method(label, random.Random, _fresh_random(name), name))
    np.random.RandomState, random.Random = RecordedState, RecordedRandom
    np.random.default_rng = lambda seed=None: (
        seed if isinstance(seed, np.random.Generator) else RecordedGenerator(rng(seed).bit_generator)
    )
    os.fork = _refuse_fork


def _drawing(generator: type) -> list[str]:
    return [name for name in dir(generator) if not name.startswith("_") and name not in QUIET]


def _recorded(name: str, call: Callable[..., Any], again: Callable[..., Any], state: Callable[[], int]) -> Any:
    @functools.wraps(call)
    def recorded(*args: Any, **kwargs: Any) -> Any:
        recorder = Recorder.active
        if recorder is None or recorder.inside or threading.current_thread() is not threading.main_thread():
            return call(*args, **kwargs)
        recorder.inside = True
        try:
            before = state()
            # The generator goes on as it would, so that equal states stand for equal seeds.
            call(*_copied(name, args), **kwargs)
            return recorder.draw(name, call, again, before, (args, kwargs))
        finally:
            recorder.inside = False

    return recorded


def _recorded_method(label: str, base: type, again: Callable[..., Any], name: str = "") -> Any:
    method = getattr(base, name or label)

    def recorded(self: Any, *args: Any, **kwargs: Any) -> Any:
        bound = functools.partial(method, self)
        return _recorded(label, functools.update_wrapper(bound, method), again, _state_of(self))(*args, **kwargs)

    return functools.wraps(method)(recorded)


def _state_of(generator: Any) -> Callable[[], int]:
    """A function that returns a number for the state of a random number generator."""
    if isinstance(generator, np.random.Generator):
        return lambda: zlib.crc32(repr(generator.bit_generator.state).encode())
    if isinstance(generator, np.random.RandomState):
        return lambda: _digest(generator.get_state())
    return lambda: zlib.crc32(repr(generator.getstate()[1][-5:]).encode())


def _digest(state: Any) -> int:
    _, key, position, *rest = state
    return zlib.crc32(key.tobytes(), position) ^ zlib.crc32(repr(rest).encode())


def _fresh_state(name: str) -> Callable[..., Any]:
    return lambda seed, args, kwargs: getattr(_STATE(seed), name)(*args, **kwargs)


def _fresh_generator(name: str) -> Callable[..., Any]:
    return lambda seed, args, kwargs: getattr(_GENERATOR(np.random.PCG64(seed)), name)(*args, **kwargs)


def _fresh_random(name: str) -> Callable[..., Any]:
    return lambda seed, args, kwargs: getattr(_RANDOM(seed), name)(*args, **kwargs)


_STATE, _GENERATOR, _RANDOM = np.random.RandomState, np.random.Generator, random.Random


def _copied(name: str, args: tuple[Any, ...]) -> tuple[Any, ...]:
    """The arguments, with a copy of what a shuffle changes."""
    return ([*args[0]], *args[1:]) if name == "shuffle" and args else args


def _frame_outside() -> FrameType:
    """The innermost frame that is not of this file."""
    frame = sys._getframe(1)
    while frame.f_code.co_filename == __file__:
        assert frame.f_back is not None
        frame = frame.f_back
    return frame


def _refuse_fork() -> int:
    raise ProgramError("It starts a copy of its process, where its draws cannot be recorded.")
