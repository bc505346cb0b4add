"""An adapter builds the asset that Infinigen's own factory builds of the same parameters, light ones too."""

import importlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pytest

from dipcg.generators import Generator, load_generator
from dipcg.mesh import Mesh, make_mesh
from dipcg.metrics import sample_surface
from dipcg.metrics.chamfer import nearest
from dipcg.space import Params
from dipcg.workers.pool import BuildPool

TESTS = Path(__file__).parents[1]
NAMES = sorted(path.stem for path in (TESTS / "factories").glob("*.py") if not path.stem.startswith("_"))
# In longest sides of the asset.
TOLERANCE = 0.01
pytestmark = pytest.mark.blender


class Asset(NamedTuple):
    """Our parameters for one of Infinigen's own assets, and its mesh."""

    params: Params
    theirs: Mesh


class Adapter(NamedTuple):
    """An adapter beside some assets of its factory."""

    generator: Generator
    factory: ModuleType
    assets: list[Asset]


@pytest.fixture(scope="module", params=NAMES)
def adapter(request, tmp_path_factory) -> Adapter:
    generator = load_generator(request.param)
    if generator.missing:
        pytest.skip("Infinigen is not installed")
    file = tmp_path_factory.mktemp("factory") / "own.npz"
    subprocess.run([sys.executable, "-m", "factories", request.param, str(file)], cwd=TESTS, check=True)
    factory, own = importlib.import_module(f"factories.{request.param}"), np.load(file)
    params = [generator.space.validate(factory.params_of(json.loads(str(own[f"{key}.own"])))) for key in factory.KEYS]
    meshes = [make_mesh(own[f"{key}.vertices"], own[f"{key}.faces"]) for key in factory.KEYS]
    return Adapter(generator, factory, [Asset(*pair) for pair in zip(params, meshes, strict=True)])


@pytest.fixture(scope="module")
def pool(adapter) -> Iterator[BuildPool]:
    with BuildPool(adapter.generator) as pool:
        yield pool


def test_an_adapter_builds_what_the_factory_builds(adapter, pool):
    for params, theirs in adapter.assets:
        ours = pool.build(params)
        np.testing.assert_allclose(ours.bounds, theirs.bounds, atol=getattr(adapter.factory, "ATOL", 1e-4))
        assert hausdorff(ours, theirs) < TOLERANCE, params
        light_tolerance = getattr(adapter.factory, "LIGHT_TOLERANCE", 2 * TOLERANCE)
        assert hausdorff(pool.build(params, "light"), theirs) < light_tolerance, params
        if hasattr(adapter.factory, "check"):
            adapter.factory.check(ours, theirs)


def test_the_assets_differ_in_what_a_factory_decides(adapter):
    for name in getattr(adapter.factory, "VARIED", ()):
        assert len({params[name] for params, _ in adapter.assets}) > 1, name


def hausdorff(a: Mesh, b: Mesh) -> float:
    """The Hausdorff distance of the surfaces, in longest sides, from samples of points."""
    rng = np.random.default_rng(0)
    first, second = (sample_surface(mesh, 300_000, rng) / a.side for mesh in (a, b))
    return max(nearest(first[:5000], second).max(), nearest(second[:5000], first).max())
