"""The classifier of pictures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from boxes import untrained

from dipcg.data.store import build_dataset
from dipcg.inference.classifier import ENCODER, fingerprint, load_classifier
from dipcg.inference.recognise import DOUBTED, at_a_glance, doubt, recognise, strangeness
from dipcg.model.checkpoint import load_checkpoint
from dipcg.model.zoo import find_checkpoint, shipped
from dipcg.pipeline import Inverter
from dipcg.training.fit import fit, summaries

EXAMPLES = Path(__file__).parents[2] / "examples" / "images"
RING = """
import trimesh
from dipcg.space import ParameterSpace, Real

space = ParameterSpace(Real("width", 0.1, 0.3, doc="of the ring"))


def build(params):
    return trimesh.creation.annulus(1.0 - params["width"], 1.0, 0.2)
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("sets")
    (folder / "ring.py").write_text(RING)
    build_dataset(str(folder / "ring.py"), folder / "ring", 60)
    build_dataset("box", folder / "box", 60)
    return [folder / "ring", folder / "box"]


def test_rings_and_boxes_are_told_apart_on_unseen_pictures(folders, tmp_path):
    # The encoder was trained on neither.
    with Inverter(*load_checkpoint(find_checkpoint(ENCODER))[:2]) as inverter:
        classifier = fit(inverter, folders, 128)
        assert classifier.names == ("ring", "box")
        for number, folder in enumerate(folders):
            _, seen = summaries(inverter, folder, 64, "test")
            found = (seen @ classifier.weight.T + classifier.bias).argmax(1)
            assert (found == number).float().mean() > 0.85
        classifier.save(tmp_path / "classifier.safetensors")
        again = load_classifier(inverter, tmp_path / "classifier.safetensors")
        torch.testing.assert_close(again.weight, classifier.weight)
        inverter.model.encoder.pool[2].bias.data += 1
        assert load_classifier(inverter, tmp_path / "classifier.safetensors") is None, "of another encoder"
        assert load_classifier(inverter, tmp_path / "missing.safetensors") is None


def test_one_kind_cannot_be_told_apart(folders):
    with untrained("box") as inverter, pytest.raises(ValueError, match="two generators or more, got 1"):
        fit(inverter, folders[:1])


def test_the_classifier_that_ships_belongs_to_the_encoder_that_ships_and_knows_all_that_ship():
    model, generator, _ = load_checkpoint(find_checkpoint(ENCODER))
    classifier = load_classifier(Inverter(model, generator))
    assert classifier is not None
    assert set(classifier.names) == set(shipped())
    assert classifier.encoder == fingerprint(Inverter(model, generator))


@pytest.mark.parametrize("name", shipped())
def test_each_example_is_recognised_without_a_build(name, monkeypatch):
    monkeypatch.setattr("dipcg.inference.recognise.rank", None)
    inverters = {other: Inverter(*load_checkpoint(find_checkpoint(other))[:2]) for other in {ENCODER, "vase", name}}
    found = recognise(EXAMPLES / f"{name}.png", inverters)
    assert found[0][0] == name
    assert np.isclose(sum(chance for _, chance in found), 1)


@pytest.mark.parametrize("name", shipped())
def test_a_picture_of_another_kind_is_doubted_without_a_build_and_its_own_is_not(name):
    with Inverter(*load_checkpoint(find_checkpoint(name))[:2]) as inverter:
        assert doubt(inverter.estimate(EXAMPLES / f"{name}.png", 1)) is None
        for other in {*shipped()} - {name, "vase"}:  # the vase could be a flower at first sight
            found = doubt(inverter.estimate(EXAMPLES / f"{other}.png", 1))
            assert found is not None
            assert f"try '{other}'" in found


def test_what_fits_badly_and_looks_like_something_else_is_the_strangest():
    assert strangeness(0.0, 1.0) == 0
    assert strangeness(1.0, 0.0) == 1
    assert strangeness(0.4, 0.3) > max(strangeness(0.2, 0.3), strangeness(0.4, 0.6))
    assert strangeness(None, 0.06) <= DOUBTED < strangeness(None, 0.04), "unranked: at first sight, where that is sure"


def test_a_picture_that_fits_badly_is_doubted_though_it_looks_like_its_kind():
    with Inverter(*load_checkpoint(find_checkpoint("chair"))[:2]) as inverter:
        found = inverter.estimate(EXAMPLES / "chair.png", 1)
    assert at_a_glance(found)["chair"] > 0.8
    assert doubt(replace(found, misfit=0.3)) is None
    assert "by only 20 %" in doubt(replace(found, misfit=0.8))


def test_a_generator_that_the_classifier_does_not_know_is_not_doubted():
    with untrained("box") as inverter:
        assert doubt(inverter.estimate(EXAMPLES / "vase.png", 1)) is None
