"""The workflow: it does what its steps do one after the other, once for each picture."""

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch
from boxes import BOX, TINY, picture, untrained, write_ball

import dipcg.images
from dipcg.images import cut_out
from dipcg.inference.estimate import Options, Result, describe, estimate, look, look_at_many
from dipcg.inference.inverters import Inverters
from dipcg.inference.rank import rank
from dipcg.inference.refine import refine
from dipcg.inference.serialise import to_dict
from dipcg.model.checkpoint import save_checkpoint
from dipcg.pipeline import Inverter

FEW = Options(candidates=3, steps=2)


@pytest.fixture(scope="module")
def inverters(tmp_path_factory) -> Iterator[Inverters]:
    """Untrained estimators of boxes and of balls, which no classifier knows."""
    folder = tmp_path_factory.mktemp("checkpoints")
    for name, ref in (("box", "box"), ("ball", write_ball(folder, most=1.0))):
        inverter = untrained(ref)
        torch.nn.init.normal_(inverter.model.denoiser.read)
        save_checkpoint(folder / name, inverter.model, inverter.generator, {})
    with Inverters([str(folder / "box"), str(folder / "ball")]) as inverters:
        yield inverters


@pytest.fixture(scope="module")
def image(inverters) -> np.ndarray:
    return picture(inverters["box"])


def plain(result: Result) -> dict:
    """What can be compared: no pictures, no meshes."""
    return json.loads(json.dumps(to_dict(result)))


def test_it_is_the_estimate_of_the_pipeline_ranked(inverters, image):
    found = estimate(image, inverters, replace(FEW, generator="box", seed=3, fixed={"width": 0.4}))
    expected = rank(inverters["box"].estimate(image, 3, 2, 3, {"width": 0.4}), inverters["box"])
    assert plain(found) == plain(Result(expected))
    assert found.estimate.misfit is not None
    unranked = estimate(image, inverters, replace(FEW, generator="box", rank=False)).estimate
    assert unranked.misfit is None
    assert len(unranked.candidates) == 3


def test_the_estimate_keeps_its_picture_whatever_size_the_encoder_takes(image):
    for size in (64, 128):
        inverter = untrained("box", replace(TINY, image_size=size))
        found = inverter.estimate(image, 2, 1)
        np.testing.assert_array_equal(found.image, cut_out(image).picture)
        # What the network itself suggests is found by its own size.
        refined = refine(rank(found, inverter), inverter, seconds=60, most_builds=3)
        assert refined.misfit is not None
        inverter.close()


@pytest.mark.slow
def test_a_search_lowers_the_misfit_and_leaves_its_trace(inverters, image, monkeypatch):
    # The search ends when it finds nothing better, and not by the time.
    monkeypatch.setattr("dipcg.inference.refine.PATIENCE", 1)
    shares: list[float] = []
    options = replace(FEW, generator="box", refine_s=1000.0)
    refined = estimate(image, inverters, options, lambda share, note: shares.append(share)).estimate
    assert refined.misfit <= estimate(image, inverters, replace(FEW, generator="box")).estimate.misfit
    assert len(refined.trace) > 1
    assert shares[:2] == [0.05, 0.1]


@pytest.mark.slow
def test_a_ball_is_recognised_where_none_is_named(inverters):
    ball = picture(inverters["ball"], {"radius": 1.0, "hole": 0.5})
    found = estimate(ball, inverters, FEW)
    assert found.estimate.generator == "ball"
    assert list(found.probabilities) == ["ball", "box"]
    assert found.doubt is None


@pytest.mark.slow
def test_a_picture_is_cut_out_once(inverters, image, monkeypatch):
    """For the classifier, the estimates of all generators, and the doubt."""
    opaque, times = dipcg.images.over_white(image), []
    read = dipcg.images.read_image
    monkeypatch.setattr("dipcg.images.cutout.read_image", lambda source: times.append(1) or read(source))
    estimate(opaque, inverters, FEW)
    assert len(times) == 1
    estimate([opaque, opaque[:, ::-1]], inverters, replace(FEW, generator="box"))
    assert len(times) == 3


def test_a_cutout_gives_what_its_picture_gives(inverters, image):
    options = replace(FEW, generator="box", rank=False)
    assert plain(estimate(cut_out(image), inverters, options)) == plain(estimate(image, inverters, options))


@pytest.mark.slow
def test_every_further_picture_is_doubted_by_itself(inverters, image):
    ball = picture(inverters["ball"], {"radius": 1.0, "hole": 0.5})
    found = estimate([image, image, ball], inverters, replace(FEW, generator="box"))
    assert len(found.view_doubts) == 2


def test_an_unknown_generator_and_no_picture_are_refused(inverters, image):
    with pytest.raises(ValueError, match="There is no generator 'bix' here"):
        estimate(image, inverters, replace(FEW, generator="bix"))
    with pytest.raises(ValueError, match="Give at least one picture"):
        estimate([], inverters, FEW)


def test_a_sentence_is_estimated_without_ranking_or_doubt():
    pytest.importorskip("transformers")

    class Untrained(Inverters):
        def _load(self, ref: str) -> Inverter:
            return untrained(ref, replace(TINY, encoder="sentence"))

    found = describe("a low box with legs", Untrained(["box"], reads="text"), replace(FEW, fixed={"width": 0.4}))
    assert found.probabilities == {"box": 1.0}
    assert (found.estimate.misfit, found.doubt) == (None, None)
    assert {candidate.params["width"] for candidate in found.estimate.candidates} == {0.4}


def test_json_has_the_old_name_of_the_probabilities_too(inverters, image):
    values = plain(estimate(image, inverters, replace(FEW, generator="box")))
    assert values["chances"] == values["probabilities"]
    assert values.keys() == {
        "generator", "generators", "candidates", "spread", "probabilities", "chances", "misfit", "doubt", "notes",
        "trace",
    }  # fmt: skip
    assert values["candidates"][0].keys() == {"params", "view", "agreement"}


def test_pictures_that_are_estimated_together_get_what_each_gets_alone(inverters, image):
    inverter, other = inverters["box"], np.ascontiguousarray(image[:, ::-1])
    asked: list = [
        (cut_out(image), 3, {"width": 0.4}),
        (cut_out(other), 4, {}),
        (cut_out(image), 5, {"lid_height": 0.2}),
    ]
    together = inverter.estimate_many(asked, candidates=3)
    for found, (cutout, seed, fixed) in zip(together, asked, strict=True):
        alone = inverter.estimate(cutout, 3, seed=seed, fixed=fixed)
        assert found.fixed == alone.fixed
        for one, same in zip(found.candidates, alone.candidates, strict=True):
            np.testing.assert_allclose(BOX.encode(one.params), BOX.encode(same.params), atol=1e-4)
        assert found.spread == pytest.approx(alone.spread, abs=1e-4)


def test_pictures_that_are_looked_at_together_get_what_each_gets_alone(inverters, image):
    asked = [(cut_out(image), Options(generator=name, candidates=2, seed=n)) for n, name in enumerate(("box", "ball"))]
    together = look_at_many([*asked, (cut_out(image), Options(candidates=2))], inverters)
    assert together[2] is None, "which of the two it is, the network alone does not say"
    for found, (cutout, options) in zip(together[:2], asked, strict=True):
        assert plain(found) == plain(look([cutout], inverters, options))
