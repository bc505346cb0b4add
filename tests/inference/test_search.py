"""Searching by building: the chain against distributions in closed form, resuming, failures, and the command."""

import contextlib
import math

import numpy as np
import pytest
from disk import full_disk
from PIL import Image

from dipcg.camera import View
from dipcg.cli import main
from dipcg.cli.mcmc import _contents
from dipcg.generators import load_generator
from dipcg.images import MARGIN, save_image
from dipcg.inference.search import Metropolis, Moves, Objective, RandomSearch, make_searcher, reflect, search
from dipcg.inference.trace import Trace, marks
from dipcg.parameter_file import params_from_json
from dipcg.render import Renderer
from dipcg.space import Choice, ParameterSpace, Real
from dipcg.workers.pool import BuildPool

pytestmark = pytest.mark.slow

SPACE = ParameterSpace(Real("a", 0, 1), Choice("b", (1, 2, 3)), Real("c", 0, 1))


def energy(point: np.ndarray) -> float:
    """A quadratic in two reals, and a cost for each of three options."""
    a, b, c = point
    return (a - 0.3) ** 2 + 0.5 * (c + 0.5) ** 2 + [0.0, 0.1, 0.3][SPACE["b"].index(SPACE["b"].decode(b))]


def scores(points):
    return (energy(point) for point in points)


@pytest.fixture(scope="module")
def visited() -> np.ndarray:
    rng = np.random.default_rng(0)
    chain = Metropolis([np.zeros(3) for _ in range(20)], Moves(SPACE, rng, 0.5, 0.4), 0.2, rng)
    states = []
    for number in range(1000):
        points = chain.ask()
        chain.tell(points, list(scores(points)))
        if number >= 50:
            states.extend(chain.states)
    return np.array(states)


@pytest.mark.parametrize(("entry", "cost"), [(0, lambda v: (v - 0.3) ** 2), (2, lambda v: 0.5 * (v + 0.5) ** 2)])
def test_a_chain_visits_reals_with_their_density(visited, entry, cost):
    grid = np.linspace(-1, 1, 20_001)
    density = np.exp(-cost(grid) / 0.2)
    density /= density.sum()
    mean = (density * grid).sum()
    assert visited[:, entry].mean() == pytest.approx(mean, abs=0.03)
    assert visited[:, entry].std() == pytest.approx(math.sqrt((density * (grid - mean) ** 2).sum()), rel=0.06)


def test_a_chain_visits_choices_with_their_probability(visited):
    weights = np.exp(-np.array([0.0, 0.1, 0.3]) / 0.2)
    found = [(np.abs(visited[:, 1] - centre) < 1e-6).mean() for centre in SPACE["b"].centres]
    np.testing.assert_allclose(found, weights / weights.sum(), atol=0.03)


def test_a_chain_does_not_move_where_nothing_can_be_built():
    rng = np.random.default_rng(0)
    chain = Metropolis([np.zeros(3)], Moves(SPACE, rng), 0.1, rng)
    chain.tell(chain.ask(), [0.5])
    chain.tell(chain.ask(), [math.inf])
    np.testing.assert_array_equal(chain.states[0], np.zeros(3))


def test_steps_beyond_the_border_are_mirrored():
    np.testing.assert_allclose(reflect(np.array([-1.3, 1.2, 0.4, 3.5, -3.1])), [-0.7, 0.8, 0.4, -0.5, 0.9])


@pytest.mark.parametrize("method", ["mcmc", "random", "cma"])
def test_every_method_finds_better_points_with_more_calls(method):
    tried = list(search(searcher(method), scores, 400))
    assert [t.call for t in tried] == list(range(1, 401))
    assert all(t.best == min(other.score for other in tried[: t.call]) for t in tried[::40])
    assert energy(tried[-1].best_point) == tried[-1].best
    assert tried[-1].best < 0.02 < tried[0].best


@pytest.mark.parametrize("method", ["mcmc", "random", "cma"])
def test_a_search_that_was_killed_anywhere_goes_on_to_the_same_end(method):
    whole = [t.score for t in search(searcher(method), scores, 60)]
    built = []

    def counted(points):
        for score in scores(points):
            built.append(score)
            yield score

    again = [t.score for t in search(searcher(method), counted, 60, whole[:23])]
    assert again == whole
    assert built == whole[23:]


def searcher(method: str):
    rng = np.random.default_rng(3)
    return make_searcher(method, _Toy(), rng, 4, 0.02, None)


class _Toy(Objective):
    """The objective of `SPACE` without anything to build."""

    def __init__(self) -> None:
        self.view, self.generator = View(0.0, 0.0), type("Toy", (), {"space": SPACE})()


def test_an_unknown_method_is_refused():
    with pytest.raises(ValueError, match=r"no method 'annealing'. There are: mcmc, random, cma"):
        searcher("annealing")


# With a generator


@pytest.fixture(scope="module")
def objective():
    with BuildPool("box", 1) as pool:
        made = Objective(pool, lambda image: float((image[..., 3] > 127).mean()), 32)
        yield made
        made.renderer.close()


def test_points_name_parameters_and_cameras(objective):
    space, rng = load_generator("box").space, np.random.default_rng(0)
    params, view = space.sample(rng), View(-100.0, 35.0, 3.0)
    point = objective.point(params, view)
    assert objective.params(point) == params
    assert vars(objective.camera(point)) == pytest.approx(vars(view))
    assert objective.dimension == len(space) + 3


def test_scores_are_those_of_the_render_of_each_point_in_order(objective):
    rng = np.random.default_rng(0)
    points = [rng.uniform(-1, 1, objective.dimension) for _ in range(3)]
    found = list(objective(points))
    assert found == [next(objective([point])) for point in points]
    assert all(0.05 < score < 1 for score in found)
    assert len(set(found)) == 3


def test_random_search_draws_its_batch():
    rng = np.random.default_rng(0)
    assert len(RandomSearch(lambda: rng.uniform(-1, 1, 3), 5).ask()) == 5


# On disk


def test_a_trace_goes_on_after_a_line_cut_short_and_refuses_other_settings(tmp_path):
    trace = Trace(tmp_path, {"seed": 0})
    for score in (0.5, math.inf, 0.25):
        trace.add(1.0, score)
    trace.close()
    with (tmp_path / "trace.jsonl").open("a") as file:
        file.write('{"seconds": 2')
    again = Trace(tmp_path, {"seed": 0})
    assert again.scores == [0.5, math.inf, 0.25]
    assert [line.best for line in again.lines] == [0.5, 0.5, 0.25]
    again.add(2.0, 0.125)
    again.close()
    with Trace(tmp_path, {"seed": 0}) as last:
        assert last.scores == [0.5, math.inf, 0.25, 0.125]
    with pytest.raises(ValueError, match="another search \\(different seed\\)"):
        Trace(tmp_path, {"seed": 1})


def test_a_full_disk_shortens_no_trace(tmp_path):
    with Trace(tmp_path, {"seed": 0}) as trace:
        for _ in range(500):
            trace.add(1.0, 0.5)
    before = (tmp_path / "trace.jsonl").read_bytes()
    with full_disk(1000), Trace(tmp_path, {"seed": 0}) as trace:
        assert len(trace.scores) == 500
        with pytest.raises(OSError):
            trace.add(2.0, 0.25)
        # What the failed line has left in the buffer is lost, as in a kill.
        with contextlib.suppress(OSError):
            trace.close()
    assert (tmp_path / "trace.jsonl").read_bytes() == before
    with Trace(tmp_path, {"seed": 0}) as trace:
        trace.add(2.0, 0.25)
        assert len(trace.scores) == 501


def test_a_damaged_trace_is_left_as_it_is(tmp_path):
    with Trace(tmp_path, {"seed": 0}) as trace:
        trace.add(1.0, 0.5)
    damaged = b"not a line\n" + (tmp_path / "trace.jsonl").read_bytes()
    (tmp_path / "trace.jsonl").write_bytes(damaged)
    with pytest.raises(ValueError, match=r"trace\.jsonl is damaged"):
        Trace(tmp_path, {"seed": 0})
    assert (tmp_path / "trace.jsonl").read_bytes() == damaged


def test_two_searches_in_one_folder_are_refused(tmp_path):
    with Trace(tmp_path, {"seed": 0}), pytest.raises(ValueError, match="Another process searches in"):
        Trace(tmp_path, {"seed": 0})


def test_another_picture_under_the_same_name_is_another_search(tmp_path):
    (tmp_path / "photo.png").write_bytes(b"one")
    before = _contents(tmp_path / "photo.png", "box", uses_checkpoint=False)
    (tmp_path / "photo.png").rename(tmp_path / "moved.png")
    assert _contents(tmp_path / "moved.png", "box", uses_checkpoint=False) == before
    (tmp_path / "photo.png").write_bytes(b"two")
    with Trace(tmp_path / "out", before):
        pass
    with pytest.raises(ValueError, match="different image"):
        Trace(tmp_path / "out", _contents(tmp_path / "photo.png", "box", uses_checkpoint=False))


def test_the_marks_are_the_papers_up_to_the_last_call():
    assert marks(10_000) == [100, 500, 1000, 2000, 5000, 10_000]
    assert marks(30) == [30]


def test_the_command_writes_what_it_found_and_goes_on_where_it_was(tmp_path, capsys):
    renderer, generator = Renderer(64), load_generator("box")
    with BuildPool("box") as pool:
        mesh = pool.build(generator.space.sample(np.random.default_rng(0)))
    save_image(np.ascontiguousarray(renderer.render(mesh, View(20.0, 20.0), margin=MARGIN)), tmp_path / "box.png")
    renderer.close()
    words = ["mcmc", str(tmp_path / "box.png"), "-g", "box", "-o", str(tmp_path / "found"), "--chains", "2"]
    main([*words, "--iterations", "5"])
    first = (tmp_path / "found/trace.jsonl").read_text().splitlines()
    main([*words, "--iterations", "101"])
    lines = (tmp_path / "found/trace.jsonl").read_text().splitlines()
    assert (len(first), len(lines), lines[:5]) == (5, 101, first)
    assert "   100 calls" in capsys.readouterr().out
    name, params = params_from_json((tmp_path / "found/best.json").read_text())
    assert generator.space.validate(params) == params
    assert name == "box"
    # The picture, and the renders after 100 and after 101 calls.
    assert Image.open(tmp_path / "found/best.png").size[0] == 3 * 256
    assert (tmp_path / "found/trace.png").stat().st_size > 1000
