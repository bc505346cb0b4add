"""What every generator must keep so that it can be learned, checked by building: `dipcg generators check`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dipcg.camera import fit, world_to_camera
from dipcg.generators import Generator, load_generator
from dipcg.importing.effects import conditions
from dipcg.importing.search import find_effects
from dipcg.importing.starts import activated, far_value, options_of
from dipcg.importing.surfaces import moved
from dipcg.importing.trials import Trials
from dipcg.mesh import Mesh
from dipcg.metrics import chamfer, surface_points
from dipcg.space import ParameterSpace, Params, Real
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError

SAMPLES, VIEWS, POINTS = 8, 10, 4000
# A mesh outside this is probably not in metres.
SMALLEST_M, LARGEST_M = 0.001, 1000.0
Built = list[tuple[Params, Mesh]]


class Finding(NamedTuple):
    """What is wrong with a generator and how to mend it; a hint is no fault."""

    text: str
    is_hint: bool = False


def check(ref: str, report: Callable[[int], None] = lambda count: None) -> Iterator[Finding]:
    """The faults of a generator, as they are found.

    Raises LookupError and ValueError with a sentence for a file that declares no generator, ModuleNotFoundError when a
    package that it needs is missing, and BuildError when it cannot be started.
    """
    generator = load_generator(ref)
    yield from _declaration(generator)
    rng = np.random.default_rng(0)
    with Trials(ref, report, math.inf) as trials:
        drawn = [generator.space.sample(rng) for _ in range(SAMPLES)]
        meshes = list(trials.pool.map(drawn, "full"))
        yield from _failures(meshes)
        built = [(params, mesh) for params, mesh in zip(drawn, meshes, strict=True) if isinstance(mesh, Mesh)]
        impure = list(_purity(ref, built)) if built else []
        yield from impure
        if not built or impure:
            # What changes by itself tells nothing about the parameters.
            return
        yield from _sizes(built)
        yield from _views(generator, built, rng)
        yield from _mirror_images(trials, generator, built)
        yield from _effects(trials, generator.space, rng)


def _declaration(generator: Generator) -> Iterator[Finding]:
    for p in generator.space:
        if isinstance(p, Real) and not p.unit:
            yield Finding(f'{p.name} has no unit; declare unit="m", "°" or what it is a share of.', True)
        if not p.doc:
            yield Finding(f"{p.name} has no doc; declare in a few words what it is.", True)
    for name in _unknown_mirrors(generator):
        yield Finding(f"mirrors names {name!r}, which is no parameter.")


def _unknown_mirrors(generator: Generator) -> list[str]:
    named = {name.lstrip("-") for pair in (generator.mirrors or {}).items() for name in pair}
    return sorted(named - set(generator.space.names))


def _failures(meshes: Sequence[Mesh | BuildError]) -> Iterator[Finding]:
    errors = [mesh for mesh in meshes if isinstance(mesh, BuildError)]
    if errors:
        yield Finding(f"{len(errors)} of {len(meshes)} random builds failed. The first: {errors[0]} {errors[0].hint}")


def _purity(ref: str, built: Built) -> Iterator[Finding]:
    """Build the same again in one other process, in reverse, because earlier builds must have no effect."""
    params, mesh = built[-1]
    with BuildPool(ref) as pool:
        again = list(pool.map([params, params, *(other for other, _ in built[-2::-1])], "full"))
    first, second = again[:2]
    if any(isinstance(one, BuildError) for one in again):
        yield Finding("A build that worked before failed in another process; keep no state between builds.")
    elif _differ(first, second):
        yield Finding("build is random: two builds with the same parameters differ. Draw from a fixed seed, if at all.")
    elif _differ(mesh, first) or any(map(_differ, [mesh for _, mesh in built[-2::-1]], again[2:])):
        yield Finding(
            "build is not pure: another process gives another mesh. Keep no state between builds, and use no clock, "
            "no id of a process, and no order of a set."
        )


def _differ(a: object, b: object) -> bool:
    """Whether both are meshes, and of different surfaces."""
    return isinstance(a, Mesh) and isinstance(b, Mesh) and moved(a, b) > 0


def _sizes(built: Built) -> Iterator[Finding]:
    sides = [mesh.side for _, mesh in built]
    if not SMALLEST_M <= min(sides) <= max(sides) <= LARGEST_M:
        yield Finding(f"Meshes are {min(sides):.3g} to {max(sides):.3g} m large; build must return metres.", True)


def _views(generator: Generator, built: Built, rng: np.random.Generator) -> Iterator[Finding]:
    for params, mesh in built:
        for view in (generator.seen_from(params).sample(rng) for _ in range(VIEWS)):
            to_camera = world_to_camera(view, mesh.centre, mesh.side)
            points = np.c_[mesh.vertices, np.ones(len(mesh.vertices))] @ to_camera.T
            projected = points @ fit(mesh.vertices, to_camera).T
            if points[:, 2].max() >= 0 or np.abs(projected[:, :2] / projected[:, 3:]).max() > 1 + 1e-6:
                yield Finding(f"The camera {view} stands inside the asset; declare greater distances in views.")
                return


def _mirror_images(trials: Trials, generator: Generator, built: Built) -> Iterator[Finding]:
    if generator.mirrors is None or _unknown_mirrors(generator):
        return
    space = generator.space
    turned = trials.meshes(space.decode(generator.mirror(space.encode(params))) for params, _ in built)
    for (_, mesh), other in zip(built, turned, strict=True):
        if isinstance(other, Mesh) and not _is_mirror_image(mesh, other):
            yield Finding(
                "A mirror image of an asset is not the asset that `mirrors` says, so training would learn from wrong "
                "pictures. Declare mirrors = None, or the parameters that a mirror turns round."
            )
            return


def _is_mirror_image(mesh: Mesh, other: Mesh) -> bool:
    a, b, again = (surface_points(m, POINTS, np.random.default_rng(i)) for i, m in enumerate((mesh, other, mesh)))
    return bool(chamfer.measure(a * np.array([-1, 1, 1]), b) < 1.1 * chamfer.measure(a, again) + 0.001)


def _effects(trials: Trials, space: ParameterSpace, rng: np.random.Generator) -> Iterator[Finding]:
    wrong = dict(_wrong_conditions(trials, space, rng))
    for name, other in wrong.items():
        yield Finding(f"The `when` of {name} is wrong: it also changes the mesh under other options of {other}.")
    effects = find_effects(space, trials.meshes, rng)
    idle = set(effects.without(space))
    for name in sorted(idle - wrong.keys()):
        if name in effects.sizes:
            yield Finding(f"{name} changes nothing in any trial; use it in build, or take it out.")
        else:
            yield Finding(f"{name} was not tried: no build with it worked, or the others took all the time.", True)
    sound = [name for name in space.names if name not in idle | wrong.keys()]
    for name, when in conditions(space, sound, effects).items():
        for other, options in ((other, tuple(options)) for other, options in when.items()):
            if set(space[name].when.get(other, ())) != set(options):
                yield Finding(f"{name} matters only under {other} = {options}; declare when={{{other!r}: {options}}}.")


def _wrong_conditions(trials: Trials, space: ParameterSpace, rng: np.random.Generator) -> Iterator[tuple[str, str]]:
    """Parameters that change the mesh where a condition says that they do not, each with the choice."""
    for p in space:
        for other, allowed in p.when.items():
            excluded = [option for option in options_of(space, other) if option not in allowed]
            starts = [activated(space, p.name, rng) | {other: option} for option in excluded]
            changed = [start | {p.name: far_value(p, start[p.name], rng)} for start in starts]
            # Once in some hundred builds Blender drops a few tiny faces by chance, so one difference proves nothing.
            if all(_changes(trials, starts, changed) for _ in range(2)):
                yield p.name, other


def _changes(trials: Trials, starts: list[Params], changed: list[Params]) -> bool:
    return any(map(_differ, trials.meshes(starts), trials.meshes(changed)))
