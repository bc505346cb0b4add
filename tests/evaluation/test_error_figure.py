"""The figure of errors by parameter: what it counts, beside answers that never look."""

import numpy as np
import pytest
from benchmarks.error_figure import draw_errors, parameter_errors
from boxes import BOX
from PIL import Image

from dipcg.space import Choice, ParameterSpace, Real

SPACE = ParameterSpace(
    Real("width", 0.0, 2.0),
    Choice("top", ("flat", "round", "none")),
    Real("bulge", 0.0, 1.0, when={"top": ("round",)}),
)


def test_errors_are_counted_where_a_parameter_is_active_and_worst_first():
    tops = ["flat", "flat", "round", "none"]
    truths = [SPACE.canonical({"width": 2.0, "top": top, "bulge": 0.75}) for top in tops]
    answers = [SPACE.canonical(truth | {"width": 1.9, "top": "round", "bulge": 1.0}) for truth in truths]
    found = {error.name: error for error in parameter_errors(SPACE, truths, answers)}
    assert list(found) == ["top", "bulge", "width"]
    # The commonest option is right in two of four cases.
    assert found["top"][1:] == pytest.approx((3 / 4, 1 / 2, 4))
    assert found["bulge"][1:] == pytest.approx((0.5, 0.5, 1))
    assert found["width"][1:] == pytest.approx((0.1, 1.0, 4))


@pytest.mark.slow
def test_a_random_answer_errs_as_uniform_draws_do():
    """Two uniform reals are 2/3 apart in x, and the middle is 1/2 away."""
    drawn = [BOX.sample(np.random.default_rng(seed)) for seed in range(1200)]
    width = {error.name: error for error in parameter_errors(BOX, drawn[::2], drawn[1::2])}["width"]
    assert width.error == pytest.approx(2 / 3, abs=0.06)
    assert width.blind == pytest.approx(1 / 2, abs=0.04)


@pytest.mark.parametrize("space", [SPACE, ParameterSpace(Real("radius", 0.0, 1.0))], ids=["both", "reals alone"])
def test_the_figure_has_bars_and_lines_and_is_written_into_a_new_folder(space, tmp_path):
    pytest.importorskip("matplotlib")
    drawn = [space.sample(np.random.default_rng(seed)) for seed in range(40)]
    draw_errors(space, parameter_errors(space, drawn[::2], drawn[1::2]), tmp_path / "new" / "errors.png")
    pixels = np.asarray(Image.open(tmp_path / "new" / "errors.png").convert("RGB")).astype(int)
    grey, red = (pixels == 153).all(2), pixels[..., 0] - pixels[..., 1] > 80
    assert grey.any()
    assert red.any()
