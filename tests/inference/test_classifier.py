"""The classifier of pictures."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from boxes import untrained

from dipcg.data.store import build_dataset
from dipcg.generators import load_generator
from dipcg.images import cut_out
from dipcg.inference.classifier import ENCODER, fingerprint, load_classifier
from dipcg.inference.inverters import Inverters
from dipcg.inference.recognise import OUT_OF_DISTRIBUTION_SCORE, doubt, out_of_distribution_score, recognise
from dipcg.model.checkpoint import load_checkpoint, save_checkpoint
from dipcg.model.zoo import find_checkpoint, shipped
from dipcg.pipeline import Inverter
from dipcg.registry import allow_code
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
    allow_code(folder / "ring.py")
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


@pytest.fixture(scope="module")
def inverters() -> Iterator[Inverters]:
    """All that ship, whether or not they can be built here."""
    with Inverters(shipped()) as inverters:
        yield inverters


@pytest.mark.parametrize("name", shipped())
def test_each_example_is_recognised_without_a_build(name, inverters, monkeypatch):
    monkeypatch.setattr("dipcg.inference.recognise.rank", None)
    picture = cut_out(EXAMPLES / f"{name}.png")
    probabilities = recognise(picture, inverters, inverters.classify(picture))
    assert next(iter(probabilities)) == name
    assert np.isclose(sum(probabilities.values()), 1)


@pytest.mark.parametrize("name", shipped())
def test_a_picture_of_another_kind_is_doubted_without_a_build_and_its_own_is_not(name, inverters):
    def sentence(shown: str) -> str | None:
        picture = cut_out(EXAMPLES / f"{shown}.png")
        return doubt(inverters[name].estimate(picture, 1), inverters.classify(picture))

    assert sentence(name) is None
    # The vase could be a flower by its class alone.
    for other in {*shipped()} - {name, "vase"}:
        assert f"try '{other}'" in sentence(other)


def test_a_network_is_loaded_when_it_is_used_and_once(monkeypatch):
    loaded, load = [], Inverter.load.__func__
    monkeypatch.setattr(Inverter, "load", classmethod(lambda cls, *words: loaded.append(words[0]) or load(cls, *words)))
    with Inverters(["vase", ENCODER, "table"]) as inverters:
        assert list(inverters) == ["vase", ENCODER, "table"]
        assert loaded == []
        assert inverters["vase"] is inverters["vase"]
        assert inverters.classify(EXAMPLES / "vase.png")["vase"] > 0.5
        assert inverters[ENCODER] is inverters[ENCODER]
    assert [Path(folder).name for folder in loaded] == ["vase", ENCODER]


def test_a_generator_that_the_classifier_does_not_know_needs_no_encoder(tmp_path):
    save_checkpoint(tmp_path / "any", untrained("box").model, load_generator("box"), {})
    with Inverters([str(tmp_path / "any")]) as inverters:
        assert list(inverters) == ["box"]
        assert inverters.classify(EXAMPLES / "chair.png") == {}
    with pytest.raises(ValueError, match=r"There is no generator 'bax' here\. Did you mean 'box'"):
        inverters.find("bax")


def test_what_fits_badly_and_looks_like_something_else_has_the_highest_score():
    score = out_of_distribution_score
    assert score(0.0, 1.0) == 0
    assert score(1.0, 0.0) == 1
    assert score(0.4, 0.3) > max(score(0.2, 0.3), score(0.4, 0.6))
    assert score(None, 0.06) <= OUT_OF_DISTRIBUTION_SCORE < score(None, 0.04), "unranked: where the class is sure"


def test_a_picture_that_fits_badly_is_doubted_though_its_class_is_right(inverters):
    picture = cut_out(EXAMPLES / "chair.png")
    estimate, classes = inverters["chair"].estimate(picture, 1), inverters.classify(picture)
    assert classes["chair"] > 0.8
    assert doubt(replace(estimate, misfit=0.3), classes) is None
    assert "by only 20 %" in doubt(replace(estimate, misfit=0.8), classes)


def test_a_generator_that_the_classifier_does_not_know_is_not_doubted(inverters):
    picture = cut_out(EXAMPLES / "vase.png")
    with untrained("box") as inverter:
        assert doubt(inverter.estimate(picture, 1), inverters.classify(picture)) is None
