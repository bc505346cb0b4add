"""Runs of a seeded program in a child process, and what they say about its draws."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from dipcg.blender.declaration import parameter_of
from dipcg.importing.starts import activated
from dipcg.importing.surfaces import moved
from dipcg.mesh import Mesh
from dipcg.space import Choice, ParameterSpace, Params
from dipcg.tracing.conditions import condition
from dipcg.tracing.declaration import settings
from dipcg.tracing.distributions import Setting
from dipcg.tracing.parameters import Entry, Run, Seen, option_at, parameters
from dipcg.workers.process import BuildError, Child

TIMEOUT_S = 60.0
# Runs with random draws, before any is aimed at what is not understood yet.
FIRST_RUNS = 12
MORE_RUNS = 24
ROUNDS = 4
# Builds that are made again in another process.
REPEATS = 4
# Meshes that differ by less than this share of their longest side have the same design.
SLIGHT = 1e-3
# A process is replaced after so many runs, because Blender slows down as it works.
RECYCLE_AFTER = 150


class Runner:
    """A child process that runs a program and reports its draws; a context manager."""

    def __init__(self, program: str, seed: int, arguments: Mapping[str, Any], timeout_s: float = TIMEOUT_S) -> None:
        self.program, self.seed, self.arguments, self.timeout_s = program, seed, dict(arguments), timeout_s
        self.failed: list[str] = []
        self._child: Child | None = None

    def run(self, values: Mapping[str, Setting], explore: int | None) -> tuple[Run, Mesh]:
        """One run, where `explore` seeds random shares for all other draws; None leaves them as in a build.

        Raises BuildError with a sentence, after which the next run has a new process if need be."""
        if self._child is not None and self._child.builds >= RECYCLE_AFTER:
            self.stop()
        self._child = self._child or Child("", "call")
        given = {address: list(setting) for address, setting in values.items()}
        message = ("tracing.runs:trace", (self.program, self.seed, self.arguments, given, explore))
        try:
            self._child.start()
            seen, shares, mesh = self._child.request(message, self.timeout_s)
        except BuildError as error:
            if error.reason != "raised":
                self.stop()
            raise
        return Run([_seen(one) for one in seen], shares), mesh

    def runs(self, many: Iterable[tuple[Mapping[str, Setting], int]], until: float) -> Iterator[Run]:
        """Runs with the values and seeds given; failed ones are left out, and noted."""
        for values, explore in many:
            if time.monotonic() > until:
                return
            try:
                yield self.run(values, explore)[0]
            except BuildError as error:
                self.failed.append(str(error))

    def meshes(self, entries: Mapping[str, Entry], many: Iterable[Params]) -> Iterator[Mesh | Exception]:
        """The meshes of parameters, in order, with an error in the place of a failed one."""
        space = space_of(entries)
        for params in many:
            try:
                yield self.run(settings(space, entries, params), None)[1]
            except BuildError as error:
                yield error

    def check_repeats(self, entries: Mapping[str, Entry]) -> None:
        """Build random parameters here, and in another process in reverse order.

        Raises ValueError when the meshes differ.
        """
        rng = np.random.default_rng(1)
        many = [space_of(entries).sample(rng) for _ in range(REPEATS)]
        first = list(self.meshes(entries, many))
        self.stop()
        again = list(self.meshes(entries, many[::-1]))[::-1]
        pairs = [(a, b) for a, b in zip(first, again, strict=True) if isinstance(a, Mesh) and isinstance(b, Mesh)]
        if not pairs:
            failed = next(one for one in [*first, *again] if not isinstance(one, Mesh))
            raise ValueError(f"{self.program} fails with other values than its own: {failed}")
        apart = [moved(a, b) for a, b in pairs]
        if any(apart):
            raise ValueError(f"{self.program} makes another mesh each time from the same draws: {_by_chance(apart)}")

    def stop(self) -> None:
        """End the process."""
        if self._child is not None:
            self._child.stop()
        self._child = None

    def __enter__(self) -> Runner:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def survey(runner: Runner, until: float) -> tuple[dict[str, Entry], dict[str, str]]:
    """The parameters of a program with the choices under which each exists, and why other draws are none.

    Raises ValueError with a sentence when no run works.
    """
    runs = list(runner.runs((({}, seed) for seed in range(FIRST_RUNS)), until))
    if not runs:
        raise ValueError(f"{runner.program} cannot be recorded: {(runner.failed or ['it takes too long.'])[0]}")
    for turn in range(1, ROUNDS):
        entries, _ = explained(runs)
        known = _addresses(runs)
        runs += runner.runs(_aimed(entries, np.random.default_rng(turn), turn), until)
        now, _ = explained(runs)
        if _conditions(now) == _conditions(entries) and known == _addresses(runs):
            break
    return explained(runs)


def explained(runs: Sequence[Run]) -> tuple[dict[str, Entry], dict[str, str]]:
    """`parameters` of all runs, with `when` for those that exist only under some options."""
    entries, left_out = parameters(runs)
    there = {name: [_is_there(entry, run) for run in runs] for name, entry in entries.items()}
    choices = {n: _options(e, runs) for n, e in entries.items() if e["kind"] in ("menu", "boolean")}
    kept: dict[str, Entry] = {}
    for name, entry in entries.items():
        # A condition names choices that come before, so that no two wait for each other.
        before = {other: options for other, options in choices.items() if other in kept}
        found = condition(there[name], before)
        if found is None:
            left_out[name] = "drawn in some runs only, and no earlier choice decides in which"
            continue
        kept[name] = entry | ({"when": {other: list(options) for other, options in found.items()}} if found else {})
    return kept, left_out


def _aimed(entries: Mapping[str, Entry], rng: np.random.Generator, turn: int) -> list[tuple[dict[str, Setting], int]]:
    """Runs in which each conditional draw should be there, in turn, and in which every option comes up."""
    space = space_of(entries)
    conditional = [p.name for p in space if p.when]
    rare = [(p.name, option) for p in space if isinstance(p, Choice) for option in p.options]
    wanted: list[Params] = [activated(space, name, rng) for name in conditional]
    wanted += [activated(space, name, rng) | {name: option} for name, option in rare]
    wanted = [wanted[i] for i in rng.permutation(len(wanted))]
    seeds = range(1000 * turn, 1000 * turn + MORE_RUNS)
    chosen = wanted[:MORE_RUNS] + [space.sample(rng) for _ in range(MORE_RUNS - len(wanted))]
    return [
        (settings(space, entries, space.canonical(params)), seed) for params, seed in zip(chosen, seeds, strict=False)
    ]


def space_of(entries: Mapping[str, Entry]) -> ParameterSpace:
    """The parameter space that entries of a declaration make."""
    return ParameterSpace(*(parameter_of(name, entry) for name, entry in entries.items()))


def _by_chance(apart: Sequence[float]) -> str:
    """How far meshes of the same draws are apart, and what may be the reason."""
    share = f"{100 * max(apart):.2g} % of the longest side"
    tries = f"in {sum(map(bool, apart))} of {len(apart)} tries they differ by up to {share}"
    if max(apart) < SLIGHT:
        return f"{tries}. Code that is not Python decides ties by chance, such as an operator of Blender."
    return f"{tries}. It uses the clock, os.urandom, the order of a set, or something else that no seed decides."


def _seen(plain: Mapping[str, Any]) -> Seen:
    lists = {key: tuple(plain[key]) for key in ("labels", "thresholds")}
    return Seen(**{**plain, **lists})


def _is_there(entry: Entry, run: Run) -> bool:
    return any(one.address == entry["draw"] for one in run.seen)


def _options(entry: Entry, runs: Sequence[Run]) -> list[Any]:
    """The option that a choice had in each run; None where it was not drawn."""
    found = [next((one for one in run.seen if one.address == entry["draw"]), None) for run in runs]
    return [one and option_at(entry, run.shares[entry["draw"]], one) for run, one in zip(runs, found, strict=True)]


def _addresses(runs: Sequence[Run]) -> int:
    return len({one.address for run in runs for one in run.seen})


def _conditions(entries: Mapping[str, Entry]) -> dict[str, Any]:
    return {name: entry.get("when") for name, entry in entries.items()}
