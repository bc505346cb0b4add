"""One run of a program for `dipcg generators add`, in a child process: what it drew, as plain values, and its mesh."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from dipcg.mesh import Mesh, MeshError
from dipcg.tracing.distributions import Setting
from dipcg.tracing.draws import MAX_ARRAY, Draw, ProgramError, address, chosen, explored
from dipcg.tracing.parameters import Seen

Report = Callable[[float, str], None]
MAX_CHARACTERS = 300


def trace(
    _: Report,
    program: str,
    seed: int,
    arguments: Mapping[str, Any],
    values: Mapping[str, Sequence[Any]],
    explore: int | None,
) -> tuple[list[dict[str, Any]], dict[str, float], Mesh]:
    """The draws of one run, the shares of those that were not given, and the mesh; `explore` seeds these shares.

    Without `explore` such draws have the value that their site gives them, as in a build of the generator.

    Raises ValueError with a sentence, with the file and line for an error of the program.
    """
    from dipcg.blender.infinigen import silence
    from dipcg.tracing.programs import run

    shares: dict[str, float] = {}
    given: dict[str, Setting] = {address: (how, number) for address, (how, number) in values.items()}
    choose = chosen(given) if explore is None else explored(explore, given, shares)
    try:
        with silence():
            mesh, draws = run(program, seed, arguments, choose)
    except (ProgramError, MeshError):
        raise
    except Exception as error:
        raise ValueError(f"It raised {described(error)}") from None
    return [asdict(one) for draw in draws if not draw.repeats for one in seen(draw)], shares, mesh


def seen(draw: Draw) -> Iterator[Seen]:
    """The components of a draw as plain values; only the first of one that cannot become a parameter."""
    of, where = draw.of, draw.site
    usable = of.kind != "other" and (of.size is None or of.size <= MAX_ARRAY)
    for index in range((of.size or 1) if usable else 1):
        low, high = of.bounds(index) if usable and of.kind != "option" else (0.0, 1.0)
        yield Seen(
            address=address(where, draw.nth, index),
            site=where.key,
            nth=draw.nth,
            size=of.size or 1,
            name=where.name,
            group=where.group,
            line=where.line,
            form=where.form,
            compared=where.compared,
            material=where.material,
            retried=where.retried,
            kind=of.kind if usable else ("other" if of.kind == "other" else "array"),
            low=low,
            high=high,
            labels=labels(of.options) if usable else (),
            thresholds=tuple(sorted(draw.thresholds)),
        )


def labels(options: Sequence[Any]) -> tuple[Any, ...]:
    """Names for options: numbers and words as they are, a class or function by its name, others by their position."""
    made = tuple(_label(option, position) for position, option in enumerate(options))
    return made if len(set(map(repr, made))) == len(made) else tuple(range(len(made)))


def _label(option: Any, position: int) -> Any:
    plain = option.item() if hasattr(option, "item") and getattr(option, "ndim", 1) == 0 else option
    if isinstance(plain, (bool, int, str)):
        return plain
    if isinstance(plain, float):
        return plain
    return getattr(plain, "__name__", None) or f"option {position + 1}"


def described(error: Exception) -> str:
    """An error in one sentence, with the last file and line of the program that it came through."""
    steps = [step for step in traceback.extract_tb(error.__traceback__) if "dipcg" not in step.filename.split(os.sep)]
    where = f" at {os.path.basename(steps[-1].filename)} line {steps[-1].lineno}" if steps else ""
    text = " ".join(str(error).split())[:MAX_CHARACTERS].rstrip(".")
    return f"{type(error).__name__}{where}{f': {text}' if text else ''}."
