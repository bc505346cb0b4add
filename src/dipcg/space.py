"""Parameter spaces: the parameters of a generator, and the paper's projection φ to [-1, 1] and back."""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

Value = float | int | str | bool
Params = dict[str, Value]
Condition = Mapping[str, tuple[Value, ...]]


@dataclass(frozen=True)
class Real:
    """A real parameter between `low` and `high`, active when every entry of `when` holds.

    `label` is what people read for its name.
    """

    name: str
    low: float | int
    high: float | int
    unit: str = ""
    doc: str = ""
    group: str = ""
    default: float | int | None = None
    when: Condition = field(default_factory=dict)
    label: str = ""

    def encode(self, value: Value) -> float:
        return 2 * (float(value) - self.low) / (self.high - self.low) - 1

    def decode(self, x: float) -> float:
        share = (min(max(float(x), -1.0), 1.0) + 1) / 2
        return self.low + share * (self.high - self.low)

    def check(self, value: Any) -> float:
        """The value as a float; raises ValueError with what is wrong with it."""
        number = _as_number(value)
        if number is None or not self.low <= number <= self.high:
            raise ValueError(
                f"{self.name} must be a number from {self.low:g} to {self.high:g}{_unit(self)}, got {value!r}."
            )
        return number

    @property
    def inactive(self) -> float:
        """The value this parameter has wherever it does nothing."""
        return (self.low + self.high) / 2 if self.default is None else self.default


@dataclass(frozen=True)
class Choice:
    """One of several options, active when every entry of `when` holds.

    `label` is what people read for its name, and `labels` for the options, where their values would mislead.
    """

    name: str
    options: tuple[Value, ...]
    unit: str = ""
    doc: str = ""
    group: str = ""
    default: Value | None = None
    when: Condition = field(default_factory=dict)
    label: str = ""
    labels: tuple[str, ...] = ()

    @property
    def centres(self) -> Float[np.ndarray, " k"]:
        """The place of each option in [-1, 1]: the middle of its piece, all pieces being equal."""
        return (2 * np.arange(len(self.options)) + 1) / len(self.options) - 1

    def index(self, value: Value) -> int:
        return self.options.index(value)

    def encode(self, value: Value) -> float:
        return float(self.centres[self.index(value)])

    def decode(self, x: float) -> Value:
        piece = int((min(max(float(x), -1.0), 1.0) + 1) / 2 * len(self.options))
        return self.options[min(piece, len(self.options) - 1)]

    def check(self, value: Any) -> Value:
        """The option that `value` names; raises ValueError with a list of the options."""
        for option in self.options:
            if type(value) is type(option) and value == option:
                return option
        # People type "1", "yes" or 1.0.
        for option in self.options:
            if str(value).lower() in _spellings(option):
                return option
        listed = ", ".join(map(str, self.options))
        near = did_you_mean(str(value), [str(option) for option in self.options])
        raise ValueError(f"{self.name} must be one of {listed}, got {value!r}.{near}")

    @property
    def inactive(self) -> Value:
        """The value this parameter has wherever it does nothing."""
        return self.options[0] if self.default is None else self.default


Parameter = Real | Choice


class ParameterSpace:
    """The declared parameters of a generator, in order; `x` is a point of it in [-1, 1]^d.

    Raises ValueError for a declaration that contradicts itself.
    """

    def __init__(self, *parameters: Parameter) -> None:
        self.parameters = parameters
        self._index = {p.name: i for i, p in enumerate(parameters)}
        if len(self._index) != len(parameters):
            raise ValueError(f"Parameter names must be unique, got {[p.name for p in parameters]}.")
        for p in parameters:
            _check_declaration(p, self)
            _check_chain(p.name, self)

    def __len__(self) -> int:
        return len(self.parameters)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    def __contains__(self, name: str) -> bool:
        return name in self._index

    def __getitem__(self, name: str) -> Parameter:
        if name not in self._index:
            raise KeyError(f"There is no parameter {name!r}.{did_you_mean(name, list(self._index))}")
        return self.parameters[self._index[name]]

    def find(self, name: str) -> tuple[int, Parameter]:
        """Position in `x` and declaration of a parameter; raises ValueError with the nearest name."""
        if name not in self:
            raise ValueError(f"There is no parameter {name!r}.{did_you_mean(name, self.names)}")
        return self._index[name], self[name]

    @property
    def names(self) -> list[str]:
        return [p.name for p in self.parameters]

    @property
    def reals(self) -> list[int]:
        """Positions of the real parameters in `x`."""
        return [i for i, p in enumerate(self.parameters) if isinstance(p, Real)]

    @property
    def choices(self) -> list[int]:
        """Positions of the choices in `x`."""
        return [i for i, p in enumerate(self.parameters) if isinstance(p, Choice)]

    def sample(self, rng: np.random.Generator) -> Params:
        """Every parameter drawn uniformly, in the canonical form."""
        return self.canonical(self._decode(rng.uniform(-1, 1, len(self))))

    def encode(self, params: Params) -> Float[np.ndarray, " d"]:
        """The paper's φ (section 3.2): parameters in natural units to `x` in [-1, 1]."""
        return np.array([p.encode(params[p.name]) for p in self.parameters])

    def decode(self, x: Float[np.ndarray, " d"]) -> Params:
        """The inverse of φ: any `x`, clipped to [-1, 1], to canonical parameters."""
        return self.canonical(self._decode(x))

    def _decode(self, x: Float[np.ndarray, " d"]) -> Params:
        return {p.name: p.decode(value) for p, value in zip(self.parameters, x.tolist(), strict=True)}

    def conditions(self, name: str) -> Iterator[tuple[str, tuple[Value, ...]]]:
        """Every condition of a parameter and of the choices that it depends on: a choice and its allowed options."""
        for choice, allowed in self[name].when.items():
            yield choice, allowed
            yield from self.conditions(choice)

    def is_active(self, name: str, params: Params) -> bool:
        """Whether the parameter can change the mesh: its conditions hold and what they name is active too."""
        return all(
            params[other] in allowed and self.is_active(other, params) for other, allowed in self[name].when.items()
        )

    def active(self, params: Params) -> Bool[np.ndarray, " d"]:
        """Which parameters are active under the given choices."""
        return np.array([self.is_active(p.name, params) for p in self.parameters])

    def canonical(self, params: Params) -> Params:
        """The same asset with every inactive parameter at its inactive value."""
        return {p.name: params[p.name] if self.is_active(p.name, params) else p.inactive for p in self.parameters}

    def validate(self, params: Mapping[str, Any]) -> Params:
        """A full set of parameters, checked, in the canonical form; raises ValueError with a sentence."""
        missing = [name for name in self.names if name not in params]
        if missing:
            raise ValueError(f"These parameters are missing: {', '.join(missing)}.")
        return self.replace({p.name: p.inactive for p in self.parameters}, params)

    def replace(self, params: Params, changes: Mapping[str, Any]) -> Params:
        """The parameters with some values changed and checked; raises ValueError with a sentence."""
        changed = dict(params)
        for name, value in changes.items():
            _, parameter = self.find(name)
            changed[name] = parameter.check(value)
        return self.canonical(changed)

    def describe(self) -> list[dict[str, Any]]:
        """The declaration as plain JSON values, in order."""
        return [_describe(p) for p in self.parameters]

    @property
    def fingerprint(self) -> str:
        """A short hash of names, ranges, options and conditions, on which a checkpoint or a data set depends."""
        essence = [{k: v for k, v in p.items() if k not in ("unit", "doc", "group")} for p in self.describe()]
        return hashlib.sha256(json.dumps(essence).encode()).hexdigest()[:16]


def did_you_mean(word: str, names: list[str]) -> str:
    """' Did you mean …?' with the nearest name, or an empty text when none is near."""
    near = difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    return f" Did you mean {near[0]!r}?" if near else ""


def _as_number(value: Any) -> float | None:
    try:
        return None if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None


def _spellings(option: Value) -> set[str]:
    words = {str(option).lower()}
    if isinstance(option, bool):
        words |= {"1", "1.0", "yes", "on"} if option else {"0", "0.0", "no", "off"}
    if isinstance(option, (int, float)) and not isinstance(option, bool):
        words |= {f"{option:g}", str(float(option))}
    return words


def _unit(parameter: Parameter) -> str:
    return f" {parameter.unit}" if parameter.unit else ""


def _describe(parameter: Parameter) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": parameter.name}
    if isinstance(parameter, Real):
        entry |= {"kind": "real", "low": float(parameter.low), "high": float(parameter.high)}
    else:
        entry |= {"kind": "choice", "options": list(parameter.options)}
    entry |= {"unit": parameter.unit, "doc": parameter.doc, "group": parameter.group, "inactive": parameter.inactive}
    return entry | {"when": {name: list(allowed) for name, allowed in parameter.when.items()}}


def _check_declaration(parameter: Parameter, space: ParameterSpace) -> None:
    name = parameter.name
    if isinstance(parameter, Real) and not parameter.low < parameter.high:
        raise ValueError(f"{name}: low must be below high, got {parameter.low} and {parameter.high}.")
    if isinstance(parameter, Choice) and len(set(map(repr, parameter.options))) < max(2, len(parameter.options)):
        raise ValueError(f"{name}: a choice needs at least two different options, got {parameter.options}.")
    if isinstance(parameter, Real) and not parameter.low <= parameter.inactive <= parameter.high:
        raise ValueError(f"{name}: the default {parameter.default} is not from {parameter.low} to {parameter.high}.")
    if isinstance(parameter, Choice) and parameter.inactive not in parameter.options:
        raise ValueError(f"{name}: the default {parameter.default!r} is not one of {parameter.options}.")
    if not isinstance(parameter.when, Mapping):
        raise ValueError(f"{name}: `when` is a dictionary from a choice to options, got {parameter.when!r}.")
    for other, allowed in parameter.when.items():
        if not isinstance(allowed, (tuple, list)):
            raise ValueError(f"{name}: `when` lists options, as in {{{other!r}: ({allowed!r},)}}; got {allowed!r}.")
        switch = space.parameters[space._index[other]] if other in space else None
        if not isinstance(switch, Choice) or not allowed or not set(allowed) <= set(switch.options):
            raise ValueError(f"{name}: `when` must name a choice and some of its options, got {other}={allowed}.")


def _check_chain(name: str, space: ParameterSpace, above: tuple[str, ...] = ()) -> None:
    if name in above:
        raise ValueError(f"{name}: `when` leads back to itself through {', '.join(above)}.")
    for other in space[name].when:
        _check_chain(other, space, (*above, name))
