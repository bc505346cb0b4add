"""Draws of parameters: spread evenly where asked for, and the same whatever is drawn beside them."""

import numpy as np
from scipy.stats import qmc

from dipcg.data.draws import Draws
from dipcg.generators import load_generator


def test_sobol_points_are_spread_more_evenly_than_independent_ones():
    table = load_generator("table")
    space = table.space
    drawn = [
        np.array([space.encode(p) for p in Draws(table, 3, way).params(range(256))]) for way in ("sobol", "uniform")
    ]
    always = [i for i, p in enumerate(space) if not p.when and i in space.reals][:4]
    sobol, uniform = (qmc.discrepancy((x[:, always] + 1) / 2) for x in drawn)
    assert sobol < uniform / 3


def test_a_sample_depends_on_its_number_and_not_on_what_is_drawn_with_it():
    box = load_generator("box")
    for way in ("sobol", "uniform"):
        draws = Draws(box, 1, way)
        assert draws.params(range(5, 8)) == draws.params(range(16))[5:8]
        assert Draws(box, 2, way).params(range(3)) != draws.params(range(3))
