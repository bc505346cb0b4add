"""What the tables set beside an estimate, on boxes and balls: blind answers, nearest shapes, rows and their order."""

import json
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from boxes import BOX, TRUTH, untrained, write_ball
from PIL import Image

from dipcg.camera import View, ViewGrid
from dipcg.cli import main
from dipcg.data.store import Store, build_dataset
from dipcg.evaluation.baselines import Shape, built_shapes, middle, shortlist, stored_shapes
from dipcg.evaluation.evaluate import Case, Plan, evaluate, pair_cases, split_cases
from dipcg.evaluation.photographs import photographed_cases
from dipcg.evaluation.reader import perfect_reading
from dipcg.images import MARGIN
from dipcg.metrics import chamfer, parameter_error, surface_points
from dipcg.pipeline import Inverter
from dipcg.render import Renderer

# Three of them are in the test split, 54 in the training split.
COUNT = 60
CHAMFER = Plan(2, 2, metrics=["chamfer"])
PARAMETERS = Plan(2, 1, metrics=["choice_accuracy", "parameter_error"])


@pytest.fixture(scope="module")
def inverter() -> Iterator[Inverter]:
    with untrained("box") as inverter:
        yield inverter


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    build_dataset("box", folder, COUNT)
    return folder


@pytest.fixture(scope="module")
def shapes(inverter) -> list[Shape]:
    return built_shapes(inverter.pool, 40)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def case_of(shape: Shape, turns: int = 0) -> Case:
    """A case whose truth is the shape, turned; its picture shows nothing of it."""
    picture = np.zeros((64, 64, 4), np.uint8)
    picture[16:48, 16:48] = 255

    def sample(count: int, rng: np.random.Generator) -> np.ndarray:
        return chamfer.quarter_turn(surface_points(shape.mesh, count, rng), turns)

    return Case("one", picture, sample)


# The mean of the prior


def test_the_middle_is_off_by_what_uniform_reals_are_from_their_middle():
    """Half of half a range, 0.5 in x; two random answers are two thirds of it apart."""
    drawn = [BOX.sample(rng(seed)) for seed in range(600)]
    error = [parameter_error.measure(BOX, truth, middle(BOX)) for truth in drawn]
    between = [parameter_error.measure(BOX, a, b) for a, b in zip(drawn[::2], drawn[1::2], strict=True)]
    assert np.mean(error) == pytest.approx(1 / 2, abs=0.03)
    assert np.mean(error) < np.mean(between)


def test_the_middle_is_valid_and_canonical():
    assert BOX.validate(middle(BOX)) == middle(BOX)


# The nearest of random shapes


def test_the_shortlist_has_the_nearest_by_many_points(shapes):
    truths, known = shapes[:5], shapes[5:25]
    for seed, truth in enumerate(truths):
        points = surface_points(truth.mesh, 10_000, rng(seed))
        every = [chamfer.measure(surface_points(shape.mesh, 10_000, rng(9)), points) for shape in known]
        listed = [shape.params for shape in shortlist(known, points)]
        assert known[int(np.argmin(every))].params in listed
        assert known[int(np.argmax(every))].params not in listed


def test_a_turned_shape_is_found_when_turns_are_allowed(shapes):
    long = max(shapes, key=lambda shape: abs(shape.points.max(0)[0] - shape.points.max(0)[1]))
    points = case_of(long, turns=1).sample(2000, rng())
    assert shortlist(shapes, points, quarter_turns=True)[0].params == long.params
    assert shortlist(shapes, points)[0].params != long.params


def test_stored_shapes_are_the_first_of_the_train_split(data):
    found = stored_shapes(data, 7)
    first = [sample.params for sample in Store(data).samples("train")][:7]
    assert [shape.params for shape in found] == first
    assert len(stored_shapes(data, 1000)) == 54
    assert all(np.abs(shape.points).max() <= 0.5 + 1e-9 for shape in found)


def test_built_shapes_follow_their_seed_and_leave_out_failures(tmp_path):
    done = []
    with untrained(write_ball(tmp_path, most=0.5)) as balls:
        found = built_shapes(balls.pool, 12, seed=3, report=done.append)
        again = built_shapes(balls.pool, 12, seed=3)
    assert 0 < len(found) < 12
    assert all(shape.params["hole"] <= 0.5 for shape in found)
    assert [shape.params for shape in again] == [shape.params for shape in found]
    assert done == list(range(1, 13))


# The table


def test_rows_go_from_bounds_to_estimates(inverter, data):
    table = evaluate(
        inverter, split_cases(data, 2), Plan(2, 2, metrics=["chamfer"], random_shapes=stored_shapes(data, 9))
    )
    blind = ["noise floor", "prior (a random one)", "mean of the prior", "nearest of 9 random"]
    assert list(table.values) == [*blind, "direct guess", "most central sample", "estimate"]
    assert all(len(values["chamfer"]) == 2 for values in table.values.values())


def test_a_shape_among_the_random_ones_is_found_to_the_noise_floor(inverter, shapes):
    for turns in (0, 1):
        cases = [case_of(shapes[3], turns)]
        table = evaluate(inverter, cases, Plan(2, 1, turns > 0, ["chamfer"], random_shapes=shapes))
        assert table.values["nearest of 40 random"]["chamfer"][0] < 0.03
        assert table.values["mean of the prior"]["chamfer"][0] > 0.05


def test_a_perfect_reader_guesses_nothing_but_what_the_picture_does_not_show(inverter):
    truth = BOX.replace(TRUTH, {"top": "flat", "has_legs": False})
    guess = BOX.replace(truth, {"width": 0.8, "depth": 0.4, "height": 0.6})
    # Seen straight from its side, a box shows its depth and height, but not how far its width goes on behind.
    assert perfect_reading(inverter, truth, View(90.0, 0.0, 2.5), guess) == truth | {"width": 0.8}
    assert perfect_reading(inverter, truth, View(30.0, 20.0, 2.5), guess) == truth


def test_a_perfect_reader_is_nearer_than_an_estimate_that_knows_nothing(inverter, data):
    table = evaluate(inverter, split_cases(data, 3), Plan(2, 1, metrics=["chamfer"], perfect=True))
    read, estimated = (table.values[row]["chamfer"] for row in ("perfect reader", "estimate"))
    assert all(one <= other for one, other in zip(read, estimated, strict=True))
    assert max(read) < 0.5 * min(estimated)


def test_a_row_does_not_depend_on_which_others_there_are(inverter, data, shapes):
    alone, beside = (
        evaluate(inverter, split_cases(data, 2), Plan(2, 2, metrics=["chamfer"], random_shapes=some))
        for some in ([], shapes)
    )
    assert {row: beside.values[row] for row in alone.values} == alone.values


def test_a_middle_that_cannot_be_built_is_the_worst_in_every_row(tmp_path, shapes):
    with untrained(write_ball(tmp_path, most=0.4)) as balls:
        table = evaluate(balls, [case_of(shapes[0]), case_of(shapes[1])], Plan(2, 1, metrics=["chamfer"]))
    assert table.failures["mean of the prior"] == 2
    assert table.values["mean of the prior"]["chamfer"] == [chamfer.worst] * 2


def test_what_has_no_choices_has_no_row_of_nothing(tmp_path):
    ball = write_ball(tmp_path, most=0.5)
    build_dataset(ball, tmp_path / "data", COUNT)
    with untrained(ball) as balls:
        table = evaluate(
            balls, split_cases(tmp_path / "data", 1), Plan(2, 1, metrics=["choice_accuracy", "parameter_error"])
        )
    assert set(table.values["estimate"]) == {"parameter_error"}
    json.dumps(table.to_dict(), allow_nan=False)


def test_a_folder_without_pairs_is_refused_before_anything_is_built(tmp_path):
    with pytest.raises(ValueError, match="has no pair chair"):
        pair_cases(tmp_path, "chair")


def test_a_negative_number_of_shapes_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(["evaluate", "chair", "--data", "nowhere", "--nearest-of", "-1"])
    assert capsys.readouterr().err == "--nearest-of is a number of shapes, 0 for none, got -1.\n"


def test_a_perfect_reader_needs_a_data_set(capsys):
    with pytest.raises(SystemExit):
        main(["evaluate", "chair", "--pairs", "nowhere", "--perfect-reader"])
    assert "(--data)" in capsys.readouterr().err


# The paper's protocol


@pytest.mark.blender
@pytest.mark.skipif(find_spec("bpy") is None, reason="bpy not installed")
def test_pictures_of_the_paper_protocol_are_of_the_shapes_from_published_cameras_and_drawn_once(data, tmp_path):
    grid = ViewGrid((30,), (20,), (2.0,))
    (case,) = photographed_cases(data, 1, grid, tmp_path)
    drawn = case.image.read_bytes()
    ours = Renderer(256, samples=0).render(case.mesh, grid.middle, margin=MARGIN)[..., 3] > 127
    theirs = np.asarray(Image.open(case.image))[..., 3] > 127
    assert (ours & theirs).sum() / (ours | theirs).sum() > 0.97
    case.image.write_bytes(b"kept")
    (again,) = photographed_cases(data, 1, grid, tmp_path)
    assert again.image.read_bytes() == b"kept" != drawn
    assert again.params == case.params
