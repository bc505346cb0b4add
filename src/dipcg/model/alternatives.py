"""The options that a picture may show besides the likeliest ones: where candidates should differ.

Plain samples of a choice whose second option has a fifth of the probability often miss it altogether. So some of the
candidates are estimated with such an option fixed, and the rest of their parameters around it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from math import prod

from dipcg.model.constraints import check_fixed
from dipcg.space import Choice, ParameterSpace, Params, Value

Probabilities = Mapping[str, Mapping[Value, float]]

# The least probability of an option for which candidates are estimated.
LEAST = 0.1
# No option counts as less likely than this: the network may be too sure.
FLOOR = 0.01


def alternatives(space: ParameterSpace, expected: Params, probabilities: Probabilities, fixed: Params) -> list[Params]:
    """Options to fix besides the expected ones, of one choice or of two, the likeliest first.

    Only choices that are active in the `expected` parameters and not `fixed` count, and only options with a probability
    of `LEAST` or more. Pairs of options that cannot be fixed together are left out.
    """
    ones = [{choice.name: option} for choice, option in _doubted(space, expected, probabilities, fixed)]
    pairs = [a | b for a, b in combinations(ones, 2) if a.keys() != b.keys()]
    possible = [options for options in [*ones, *pairs] if _possible(space, fixed | options)]
    return sorted(possible, key=lambda options: _odds(options, expected, probabilities), reverse=True)


def shares(space: ParameterSpace, many: Sequence[Params], probabilities: Probabilities) -> list[float]:
    """The probability that each of many parameter sets stands for: those with the same options share theirs.

    The options are those of the choices that have more than one option with a probability of `LEAST` or more.
    """
    doubted = [p.name for p in space if isinstance(p, Choice) and _is_doubted(probabilities[p.name])]
    kinds = [tuple(params[name] for name in doubted) for params in many]
    whole = {kind: prod(max(probabilities[n][o], FLOOR) for n, o in zip(doubted, kind, strict=True)) for kind in kinds}
    return [whole[kind] / kinds.count(kind) for kind in kinds]


def _doubted(
    space: ParameterSpace, expected: Params, probabilities: Probabilities, fixed: Params
) -> Iterator[tuple[Choice, Value]]:
    active = space.active(expected)
    for index in space.choices:
        choice = space.parameters[index]
        assert isinstance(choice, Choice)
        if active[index] and choice.name not in fixed:
            likely = probabilities[choice.name]
            yield from ((choice, o) for o in choice.options if o != expected[choice.name] and likely[o] >= LEAST)


def _is_doubted(probabilities: Mapping[Value, float]) -> bool:
    return sum(probability >= LEAST for probability in probabilities.values()) > 1


def _possible(space: ParameterSpace, options: Params) -> bool:
    try:
        check_fixed(space, options)
    except ValueError:
        return False
    return True


def _odds(options: Params, expected: Params, probabilities: Probabilities) -> float:
    """The probability of the options against that of the expected ones."""
    return prod(probabilities[n][o] / max(probabilities[n][expected[n]], 1e-9) for n, o in options.items())
