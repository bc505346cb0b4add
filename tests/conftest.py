"""Settings of all tests, and what several files need."""

import os
from pathlib import Path

# The suite runs in several processes, and threads that share a processor wait for each other. Children inherit this.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import settings
from markers import MARKED, TESTS

from dipcg.export.asset import Asset
from dipcg.generators import load_generator
from dipcg.mesh.surface import Maps, corner_normals
from dipcg.workers.pool import BuildPool

# A loaded machine is no failure.
settings.register_profile("steady", deadline=None)
settings.load_profile("steady")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests above, and those with a browser."""
    for item in items:
        name = f"{item.path.relative_to(TESTS).as_posix()}::{item.name}"
        for marker, places in MARKED.items():
            if name.startswith(tuple(places)):
                item.add_marker(marker)
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker("browser")


@pytest.fixture(scope="session")
def pretrained(tmp_path_factory) -> dict[str, str]:
    """Folders of pretrained networks by encoder, as `hf download` would leave them: tiny, with random weights."""
    transformers = pytest.importorskip("transformers")
    sizes = {"hidden_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2, "intermediate_size": 64}
    networks = {
        "dinov2": transformers.Dinov2Model(transformers.Dinov2Config(image_size=518, patch_size=14, **sizes)),
        "clip": transformers.CLIPVisionModel(transformers.CLIPVisionConfig(image_size=224, patch_size=16, **sizes)),
    }
    folder: Path = tmp_path_factory.mktemp("pretrained")
    for name, network in networks.items():
        network.save_pretrained(folder / name)
    return {name: str(folder / name) for name in networks}


@pytest.fixture(scope="session")
def asset() -> Asset:
    """A box with a lid and legs: three parts, no two sides of equal length."""
    box = load_generator("box")
    changes = {"width": 0.5, "depth": 0.8, "top": "pyramid", "overhang": 0.1, "has_legs": True, "leg_height": 0.3}
    params = box.space.replace(box.space.sample(np.random.default_rng(0)), changes)
    with BuildPool("box") as pool:
        return Asset(pool.build(params), "box", params)


@pytest.fixture(scope="session")
def textured(asset) -> Asset:
    """The asset with maps in which no two numbers are alike."""
    rng, faces = np.random.default_rng(0), len(asset.mesh.faces)
    colours, normal = rng.integers(0, 255, (2, 8, 8, 3), dtype=np.uint8)
    grey = rng.integers(0, 255, (2, 8, 8), dtype=np.uint8)
    uv = rng.random((faces, 3, 2), dtype=np.float32)
    maps = Maps(uv, corner_normals(asset.mesh), colours, grey[0], grey[1], normal)
    return Asset(asset.mesh, asset.generator, asset.params, maps)


@pytest.fixture(scope="session")
def studio(tmp_path_factory):
    """What visitors of the app share, over the toy: one for all tests, since starting takes seconds."""
    from serving import Quick, box_checkpoint

    with Quick([box_checkpoint(tmp_path_factory.mktemp("checkpoint"))], workers=1) as studio:
        yield studio


@pytest.fixture(scope="session")
def mesh(studio):
    from boxes import TRUTH

    return studio.submit("box", TRUTH, "light").result()


@pytest.fixture(scope="session")
def picture(mesh, tmp_path_factory) -> Path:
    from boxes import VIEW

    from dipcg.images import MARGIN, save_image
    from dipcg.render import Renderer

    path, renderer = tmp_path_factory.mktemp("pictures") / "box.png", Renderer(256)
    save_image(renderer.render(mesh, VIEW, margin=MARGIN), path)
    renderer.close()
    return path


@pytest.fixture(scope="session")
def address(studio, tmp_path_factory):
    """Of a server of the app."""
    from serving import serving

    with serving(studio, tmp_path_factory.mktemp("served")) as address:
        yield address
