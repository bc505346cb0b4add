"""Recording and replaying draws, in a process of its own, because recording functions stay in NumPy for good."""

import json
import subprocess
import sys
import textwrap

import pytest

HEAD = """
import json, random
from dipcg.tracing.draws import Recorder, address, chosen, explored, install
install()
import numpy as np
from numpy.random import uniform

def recorded(function, values=None, seed=0, explore=None):
    def top():
        return function()
    shares = {}
    given = values or {}
    choose = chosen(given) if explore is None else explored(explore, given, shares)
    with Recorder(seed, choose, top.__code__) as recorder:
        made = top()
    return made, [address(d.site, d.nth, 0) for d in recorder.draws], recorder.draws
"""


def run(body: str):
    """What a program in a new process prints as JSON."""
    code = HEAD + textwrap.dedent(body)
    # A file, because the names and columns of draws are read from it.
    done = subprocess.run([sys.executable, "-"], input=code, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    "draw",
    [
        "uniform(1, 2)",
        "np.random.rand()",
        "np.random.normal(3, 2)",
        "random.uniform(1, 2)",
        "random.gauss(0, 1)",
        "np.random.lognormal(0, 0.5)",
        "random.lognormvariate(0, 0.5)",
        "np.random.triangular(1, 2, 4)",
        "random.triangular(1, 4, 2)",
        "np.random.beta(2, 3)",
        "random.betavariate(2, 3)",
        "np.random.exponential(2)",
        "random.expovariate(2)",
        "np.random.default_rng(4).random()",
        "np.random.RandomState(4).uniform()",
        "random.Random(4).random()",
        "int(np.random.randint(2, 9))",
        "random.randint(2, 9)",
        "random.choice([3, 4, 5])",
        "int(np.random.choice([3, 4, 5]))",
        "int(np.random.default_rng(4).integers(3, 9))",
    ],
)
def test_a_recorded_draw_is_replayed_under_another_seed(draw):
    same, ends, other = run(f"""
    def program():
        return {draw}
    made, addresses, _ = recorded(program, seed=1, explore=1)
    def at(share, seed):
        return recorded(program, {{addresses[0]: ("share", share)}}, seed)[0]
    print(json.dumps([at(0.2, 3) == at(0.2, 4), [at(0.0, 0), at(0.999, 0)], [len(addresses)]]))
    """)
    assert same
    assert ends[0] < ends[1]
    assert other == [1]


def test_a_draw_more_changes_no_other():
    with_it, without = run("""
    def program(more):
        if more:
            uniform()
        return uniform()
    print(json.dumps([recorded(lambda: program(more))[0] for more in (True, False)]))
    """)
    assert with_it == without


def test_repeats_are_numbered_and_a_seed_set_again_gives_the_same_numbers():
    repeats, values, again = run("""
    def program():
        made = []
        for _ in range(2):
            np.random.seed(5)
            made.append([uniform() for _ in range(3)])
        return made
    made, addresses, draws = recorded(program)
    print(json.dumps([[d.nth for d in draws], made, [d.repeats for d in draws]]))
    """)
    assert repeats == [1, 2, 3, 1, 2, 3]
    assert values[0] == values[1]
    assert again == [False] * 3 + [True] * 3


def test_what_a_draw_is_compared_with_is_noted():
    thresholds, kind = run("""
    import linecache, sys
    source = "def program(uniform):\\n    r = uniform()\\n    return r < 0.3 or r > 0.8\\n"
    linecache.cache["program.py"] = (len(source), None, source.splitlines(True), "program.py")
    space = {}
    exec(compile(source, "program.py", "exec"), space)
    _, _, draws = recorded(lambda: space["program"](uniform), explore=1)
    both = set()
    for seed in range(8):
        both |= recorded(lambda: space["program"](uniform), explore=seed)[2][0].thresholds
    print(json.dumps([sorted(both), draws[0].site.name]))
    """)
    assert thresholds == [0.3, 0.8]
    assert kind == "r"


def test_arrays_shuffles_and_other_distributions_depend_on_the_site_alone():
    assert run("""
    def program():
        order = list(range(5))
        random.shuffle(order)
        np.random.shuffle(order)
        return [order, np.random.uniform(size=20).tolist(), np.random.beta(1, 2), np.random.permutation(3).tolist()]
    print(json.dumps(recorded(program)[0] == recorded(program)[0]))
    """)


def test_outside_a_recording_nothing_is_changed():
    assert run("""
    np.random.seed(3)
    ours = uniform(size=4).tolist()
    print(json.dumps(ours == np.random.RandomState(3).uniform(size=4).tolist()))
    """)


@pytest.mark.slow
def test_a_program_that_forks_or_draws_without_end_is_refused():
    said = run("""
    import os
    said = []
    def endless():
        while True:
            uniform()
    for program in (os.fork, endless):
        try:
            recorded(program)
        except ValueError as error:
            said.append(str(error))
    print(json.dumps(said))
    """)
    assert ["copy of its process" in said[0], "more than 5,000" in said[1]] == [True, True]
