"""The contract of generators, checked for each registered generator and for the examples."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dipcg import registry
from dipcg.camera import fit, world_to_camera
from dipcg.generators import load_generator
from dipcg.mesh import Mesh
from dipcg.metrics import chamfer, surface_points
from dipcg.registry import allow_code
from dipcg.space import Choice, ParameterSpace, Params, Real
from dipcg.workers.pool import BuildPool

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = [*registry.names("generators"), *(str(EXAMPLES / name) for name in ("lamp.toml", "seashell.py"))]
IDS = [Path(name).name for name in NAMES]
allow_code(*NAMES)
# The number of random assets of each generator.
SAMPLES = 6
# The number of starting points from which a parameter is changed before it counts as one without an effect.
ROUNDS = 8

declared = pytest.mark.parametrize("generator", [load_generator(name) for name in NAMES], ids=IDS)


def _built(name: str) -> pytest.param:
    generator = load_generator(name)
    marks = [pytest.mark.blender] if "bpy" in generator.needs else []
    if generator.missing:
        marks.append(pytest.mark.skip(reason=f"{' and '.join(generator.missing)} not installed"))
    return pytest.param(name, marks=marks, id=Path(name).name)


@pytest.fixture(scope="module", params=[_built(name) for name in NAMES])
def pool(request) -> Iterator[BuildPool]:
    with BuildPool(request.param, workers=2) as pool:
        yield pool


@pytest.fixture(scope="module")
def samples(pool) -> list[tuple[Params, Mesh]]:
    """Random parameters with their full meshes."""
    rng = np.random.default_rng(0)
    params = [pool.generator.space.sample(rng) for _ in range(SAMPLES)]
    return list(zip(params, build_all(pool, params, "full"), strict=True))


def build_all(pool: BuildPool, params: list[Params], detail: str) -> list[Mesh]:
    meshes = list(pool.map(params, detail))
    for mesh in meshes:
        if isinstance(mesh, Exception):
            raise mesh
    return meshes


def same(a: Mesh, b: Mesh) -> bool:
    """Whether the faces are equal and the vertices differ by less than a millionth of the longest side.

    Blender's bevel adds numbers in an order that depends on memory addresses, so that vertices differ by rounding.
    """
    if a.vertices.shape != b.vertices.shape or not np.array_equal(a.faces, b.faces):
        return False
    return bool(np.abs(a.vertices - b.vertices).max() < 1e-6 * a.side)


def differs(a: Mesh, b: Mesh) -> bool:
    """Whether the shapes differ by more than rounding."""
    return a.vertices.shape != b.vertices.shape or not np.allclose(a.vertices, b.vertices, atol=1e-5 * a.side)


def points_of(*meshes: Mesh) -> list[np.ndarray]:
    return [surface_points(mesh, 4000, np.random.default_rng(i)) for i, mesh in enumerate(meshes)]


# The declaration, which needs no Blender


@pytest.mark.parametrize("name", NAMES, ids=IDS)
def test_a_generator_loads_without_blender(name):
    block = "import sys; sys.modules.update(bpy=None, infinigen=None, torch=None)"
    allow = f"from dipcg.registry import allow_code; allow_code({name!r})" if registry.is_path(name) else "pass"
    load = f"{allow}; from dipcg.generators import load_generator; load_generator({name!r})"
    subprocess.run([sys.executable, "-c", f"{block}; {load}"], check=True)


@declared
def test_the_file_and_every_parameter_are_documented(generator):
    assert generator.doc
    assert [p.name for p in generator.space if not p.doc] == []
    assert [p.name for p in generator.space if isinstance(p, Real) and not p.unit] == [], "reals without a unit"


@declared
def test_parameters_have_names_that_work_on_a_command_line(generator):
    assert len(set(generator.space.names)) == len(generator.space)
    assert all(name.isidentifier() for name in generator.space.names)


@declared
def test_decoding_inverts_encoding(generator):
    rng = np.random.default_rng(0)
    for _ in range(20):
        params = generator.space.sample(rng)
        assert generator.space.decode(generator.space.encode(params)) == pytest.approx(params, abs=1e-12)


@pytest.mark.slow
@declared
def test_every_parameter_is_sometimes_active_and_every_conditional_one_sometimes_inactive(generator):
    rng = np.random.default_rng(0)
    for p in generator.space:
        assert generator.space.is_active(p.name, activated(generator.space, p.name, rng))
    active = np.mean([generator.space.active(generator.space.sample(rng)) for _ in range(300)], axis=0)
    assert [p.name for p, share in zip(generator.space, active, strict=True) if p.when and share == 1] == []


@declared
def test_mirroring_twice_changes_nothing(generator):
    x = np.random.default_rng(0).uniform(-1, 1, len(generator.space))
    np.testing.assert_array_equal(generator.mirror(generator.mirror(x)), x)


# The meshes


def test_meshes_are_valid(samples):
    for _, mesh in samples:
        assert len(mesh.vertices) > 0
        assert len(mesh.faces) > 0
        assert np.isfinite(mesh.vertices).all()
        assert mesh.faces.min() >= 0
        assert mesh.faces.max() < len(mesh.vertices)
        assert mesh.parts.max() < len(mesh.part_names)
        assert mesh.side > 0


def test_parts_have_distinct_names(samples):
    for _, mesh in samples:
        assert len(set(mesh.part_names)) == len(mesh.part_names)


def test_another_process_builds_the_same_mesh(pool, samples):
    # The order is reversed, because earlier builds must have no effect on later ones.
    with BuildPool(pool.generator.ref) as other:
        for params, mesh in reversed(samples):
            assert same(other.build(params), mesh), params


def test_light_meshes_have_the_shape_of_full_ones(pool, samples):
    light = build_all(pool, [params for params, _ in samples], "light")
    for (params, full), coarse in zip(samples, light, strict=True):
        a, b, again = points_of(full, coarse, full)
        assert chamfer.measure(a, b) < chamfer.measure(a, again) + 0.01, params


def test_every_training_view_contains_the_whole_asset(pool, samples):
    rng = np.random.default_rng(0)
    for params, mesh in samples:
        for view in (pool.generator.seen_from(params).sample(rng) for _ in range(10)):
            to_camera = world_to_camera(view, mesh.centre, mesh.side)
            points = np.c_[mesh.vertices, np.ones(len(mesh.vertices))] @ to_camera.T
            assert points[:, 2].max() < 0, "all of it lies before the camera"
            projected = points @ fit(mesh.vertices, to_camera).T
            assert np.abs(projected[:, :3] / projected[:, 3:]).max() <= 1


def test_a_mirror_image_is_the_asset_of_the_mirrored_parameters(pool, samples):
    """Training flips pictures, so the flipped picture must show the asset of the mirrored parameters."""
    if pool.generator.mirrors is None:
        pytest.skip("its mirror images are no assets of this generator")
    space, mirror = pool.generator.space, pool.generator.mirror
    mirrored = build_all(pool, [space.decode(mirror(space.encode(params))) for params, _ in samples], "full")
    for (params, mesh), other in zip(samples, mirrored, strict=True):
        a, b, again = points_of(mesh, other, mesh)
        assert chamfer.measure(a * np.array([-1, 1, 1]), b) < 1.1 * chamfer.measure(a, again) + 0.001, params


@pytest.mark.slow
def test_inactive_values_never_change_the_mesh(pool):
    rng = np.random.default_rng(1)
    space = pool.generator.space
    plain = [with_option(space, p, option, rng) for p in space if isinstance(p, Choice) for option in p.options]
    noisy = [params | random_inactive_values(space, params, rng) for params in plain]
    before, after = build_all(pool, plain, "light"), build_all(pool, noisy, "light")
    for params, a, b in zip(plain, before, after, strict=True):
        assert same(a, b), params


@pytest.mark.slow
def test_under_each_option_every_active_parameter_changes_the_mesh(pool):
    rng = np.random.default_rng(2)
    space = pool.generator.space
    remaining = {(p.name, c.name, o) for p in space for c in space if isinstance(c, Choice) for o in c.options}
    remaining = {(p.name, *ANY_OPTIONS) for p in space} | {pair for pair in remaining if joint(space, *pair, rng)}
    for _ in range(ROUNDS):
        remaining -= set(pairs_with_effect(pool, probes(space, remaining, rng)))
    assert not remaining, f"no effect of (parameter, under choice, option): {sorted(remaining, key=str)}"


# A parameter, a choice and one of its options, under which the effect of the parameter is looked for.
Pair = tuple[str, str, object]
# Stands for a choice and its option where the effect may be under any options, since a generator may have no choices.
ANY_OPTIONS = ("", None)


def probes(space: ParameterSpace, remaining: set[Pair], rng: np.random.Generator) -> list[tuple[str, Params, Params]]:
    """For every remaining pair a start under its option, and the same with the parameter far away.

    A greedy choice of starts keeps the number of builds low.
    """
    starts: list[Params] = []
    for pair in sorted(remaining, key=str):
        if not any(pair in pairs_of(space, pair[0], start) for start in starts):
            starts.append(joint(space, *pair, rng))
    return [
        (name, start, space.replace(start, {name: far_value(space, name, start, rng)}))
        for name in sorted({name for name, _, _ in remaining})
        for start in cover(space, name, {pair for pair in remaining if pair[0] == name}, starts)
    ]


def cover(space: ParameterSpace, name: str, remaining: set[Pair], starts: list[Params]) -> Iterator[Params]:
    """A few of the starts that together cover all remaining pairs of one parameter."""
    while remaining:
        start = max(starts, key=lambda start: len(remaining & pairs_of(space, name, start)))
        remaining = remaining - pairs_of(space, name, start)
        yield start


def pairs_with_effect(pool: BuildPool, chosen: list[tuple[str, Params, Params]]) -> Iterator[Pair]:
    starts = list({id(start): start for _, start, _ in chosen}.values())
    before = dict(zip(map(id, starts), build_all(pool, starts, "light"), strict=True))
    after = build_all(pool, [changed for _, _, changed in chosen], "light")
    for (name, start, _), mesh in zip(chosen, after, strict=True):
        if differs(before[id(start)], mesh):
            yield from pairs_of(pool.generator.space, name, start)


def pairs_of(space: ParameterSpace, name: str, params: Params) -> set[Pair]:
    if not space.is_active(name, params):
        return set()
    choices = [c.name for c in space if isinstance(c, Choice) and space.is_active(c.name, params)]
    return {(name, *ANY_OPTIONS)} | {(name, choice, params[choice]) for choice in choices}


def joint(space: ParameterSpace, name: str, choice: str, option: object, rng: np.random.Generator) -> Params | None:
    """Random parameters with `name` and `choice` active and `choice` at `option`; None if there are none."""
    if (choice, option) == ANY_OPTIONS:
        return activated(space, name, rng)
    for _ in range(20):
        params = activated(space, name, rng, with_option(space, space[choice], option, rng))
        if params[choice] == option and space.is_active(choice, params):
            return params
    return None


def with_option(space: ParameterSpace, choice: Choice, option: object, rng: np.random.Generator) -> Params:
    return space.canonical(activated(space, choice.name, rng) | {choice.name: option})


def activated(space: ParameterSpace, name: str, rng: np.random.Generator, start: Params | None = None) -> Params:
    """Random parameters, or those of `start`, with choices changed so that `name` is active."""
    params = {p.name: random_value(p, rng) for p in space} if start is None else dict(start)
    missing = [name]
    while missing:
        for other, allowed in space[missing.pop()].when.items():
            missing.append(other)
            if params[other] not in allowed:
                params[other] = allowed[rng.integers(len(allowed))]
    return space.canonical(params)


def random_inactive_values(space: ParameterSpace, params: Params, rng: np.random.Generator) -> Params:
    return {p.name: random_value(p, rng) for p in space if not space.is_active(p.name, params)}


def random_value(parameter: Real | Choice, rng: np.random.Generator) -> object:
    return parameter.decode(rng.uniform(-1, 1))


def far_value(space: ParameterSpace, name: str, start: Params, rng: np.random.Generator) -> object:
    """The farther end of a real parameter's range, or another option of a choice."""
    parameter = space[name]
    if isinstance(parameter, Real):
        return parameter.low if parameter.encode(start[name]) > 0 else parameter.high
    others = [option for option in parameter.options if option != start[name]]
    return others[rng.integers(len(others))]
