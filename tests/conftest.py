"""Settings of all tests, and what several files need."""

from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("steady", deadline=None)  # a loaded machine is no failure
settings.load_profile("steady")


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
