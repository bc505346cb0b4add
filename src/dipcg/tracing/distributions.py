"""What a call to a random number generator draws from, and the draw that a chosen value stands for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

# A normal draw lies within so many standard deviations as a parameter.
SIGMAS = 2.0
# An exponential draw lies within so many times its mean as a parameter.
EXPONENTIAL = 4.0


@dataclass(frozen=True)
class Distribution:
    """What one call draws: `size` values, each uniform, normal, an integer, or one of some options."""

    kind: str
    """uniform, normal, integer, option, or other for what cannot become a parameter"""
    low: Any = 0.0
    """Of an integer the lowest value, of a normal draw the mean"""
    high: Any = 1.0
    """Of an integer the first value above the highest, of a normal draw the standard deviation"""
    options: tuple[Any, ...] = ()
    size: int | None = None
    """None for a single number that is no array"""
    shape: tuple[int, ...] = ()

    def bounds(self, index: int) -> tuple[float, float]:
        """`low` and `high` of one component."""
        low, high = (np.broadcast_to(np.asarray(b, float), self.shape or ()).ravel() for b in (self.low, self.high))
        return float(low[index]), float(high[index])


def distribution(method: str, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Distribution:
    """The distribution of a call of NumPy or of `random`; one of kind "other" for what cannot become a parameter."""
    reader = READERS.get(method)
    if reader is None:
        return Distribution("other")
    try:
        return reader(*args, **kwargs)
    except (TypeError, ValueError):
        # The call has a form that is not known here, or is wrong; the generator itself then says so.
        return Distribution("other")


# How a number sets a draw, and that number: as the "value" itself, as a "share" of what the distribution allows, from 0
# to 1, or as the "position" of an option.
Setting = tuple[str, float]


def value_of(of: Distribution, index: int, setting: Setting) -> Any:
    """The value of a draw, or of one component of it."""
    how, number = setting
    if how == "value":
        return round(number) if of.kind == "integer" else float(number)
    if how == "position":
        count = count_of(of, index)
        position = min(int(number), count - 1)
        return of.options[position] if of.kind == "option" else int(of.bounds(index)[0]) + position
    return _at_share(of, index, number)


def share_of(of: Distribution, index: int, setting: Setting) -> float:
    """The share of its range at which a setting puts a draw; half for a value."""
    how, number = setting
    return (number + 0.5) / count_of(of, index) if how == "position" else number if how == "share" else 0.5


def count_of(of: Distribution, index: int) -> int:
    """The number of options or integers that a draw can be."""
    if of.kind == "option":
        return len(of.options)
    low, high = of.bounds(index)
    return int(high) - int(low)


def _at_share(of: Distribution, index: int, share: float) -> Any:
    if of.kind in ("option", "integer"):
        count = count_of(of, index)
        return value_of(of, index, ("position", min(int(share * count), count - 1)))
    low, high = of.bounds(index)
    if of.kind == "normal":
        return low + (2 * share - 1) * SIGMAS * high
    # `uniform` never returns its upper bound, and a program may rely on that.
    return low + min(share, 1 - 1e-9) * (high - low)


def _uniform(low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Distribution:
    return _shaped("uniform", low, high, size)


def _unit(size: Any = None, *_: Any, **__: Any) -> Distribution:
    return _shaped("uniform", 0.0, 1.0, size)


def _normal(loc: Any = 0.0, scale: Any = 1.0, size: Any = None) -> Distribution:
    return _shaped("normal", loc, scale, size)


def _standard_normal(size: Any = None, *_: Any, **__: Any) -> Distribution:
    return _shaped("normal", 0.0, 1.0, size)


def _gauss(mu: float = 0.0, sigma: float = 1.0) -> Distribution:
    return _shaped("normal", mu, sigma, None)


def _integers(low: Any, high: Any = None, size: Any = None, dtype: Any = int, endpoint: bool = False) -> Distribution:
    low, high = (0, low) if high is None else (low, high)
    return _shaped("integer", low, np.asarray(high) + endpoint, size)


def _randint_of_random(a: int, b: int) -> Distribution:
    return _shaped("integer", a, b + 1, None)


def _randrange(start: int, stop: int | None = None, step: int = 1) -> Distribution:
    return _options(range(start) if stop is None else range(start, stop, step))


def _choice(a: Any, size: Any = None, replace: bool = True, p: Any = None, *_: Any, **__: Any) -> Distribution:
    if size is not None and not replace:
        return Distribution("other")
    return _options(range(int(a)) if np.ndim(a) == 0 else list(a), size, p)


def _triangular(left: Any, mode: Any, right: Any, size: Any = None) -> Distribution:
    return _shaped("uniform", left, right, size)


def _triangular_of_random(low: float = 0.0, high: float = 1.0, mode: float | None = None) -> Distribution:
    return _shaped("uniform", low, high, None)


def _beta(a: Any, b: Any, size: Any = None) -> Distribution:
    return _shaped("uniform", np.zeros(np.broadcast_shapes(np.shape(a), np.shape(b))), 1.0, size)


def _exponential(scale: Any = 1.0, size: Any = None) -> Distribution:
    """From 0 to what 98 % of the draws stay below."""
    return _shaped("uniform", 0.0, np.asarray(scale) * EXPONENTIAL, size)


def _lognormal(mean: Any = 0.0, sigma: Any = 1.0, size: Any = None) -> Distribution:
    low, high = (np.exp(np.asarray(mean) + side * np.asarray(sigma)) for side in (-SIGMAS, SIGMAS))
    return _shaped("uniform", low, high, size)


def _binomial(n: Any, p: Any, size: Any = None) -> Distribution:
    return _shaped("integer", 0, np.asarray(n) + 1, size)


def _options(values: Sequence[Any], size: Any = None, p: Any = None) -> Distribution:
    possible = [value for i, value in enumerate(values) if p is None or p[i] > 0]
    if not possible:
        return Distribution("other")
    shape = _shape(size)
    return Distribution("option", 0, 1, tuple(possible), None if size is None else math.prod(shape), shape)


def _shaped(kind: str, low: Any, high: Any, size: Any) -> Distribution:
    shape = np.broadcast_shapes(np.shape(low), np.shape(high)) if size is None else _shape(size)
    scalar = size is None and not shape
    return Distribution(kind, low, high, (), None if scalar else math.prod(shape), shape)


def _shape(size: Any) -> tuple[int, ...]:
    return () if size is None else tuple(int(n) for n in np.atleast_1d(size))


READERS: dict[str, Callable[..., Distribution]] = {
    "uniform": _uniform,
    "rand": lambda *shape: _unit(shape or None),
    "random": _unit,
    "random_sample": _unit,
    "ranf": _unit,
    "sample": _unit,
    "normal": _normal,
    "randn": lambda *shape: _standard_normal(shape or None),
    "standard_normal": _standard_normal,
    "gauss": _gauss,
    "normalvariate": _gauss,
    "randint": _integers,
    "integers": _integers,
    "random_integers": lambda low, high=None, size=None: _integers(low, high, size, endpoint=True),
    "choice": _choice,
    "binomial": _binomial,
    "triangular": _triangular,
    "random.triangular": _triangular_of_random,
    "beta": _beta,
    "betavariate": _beta,
    "exponential": _exponential,
    "expovariate": lambda lambd=1.0: _exponential(1 / lambd),
    "lognormal": _lognormal,
    "lognormvariate": _lognormal,
    "random.randint": _randint_of_random,
    "random.randrange": _randrange,
    "random.uniform": lambda a, b: _shaped("uniform", a, b, None),
    "random.choice": lambda seq: _options(list(seq)),
    "random.random": lambda: _unit(),
}
