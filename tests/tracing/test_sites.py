"""Names of draws: what a draw is assigned to, read from the source, and how it is used."""

import ast
import sys

import pytest

from dipcg.tracing.programs import _call_function
from dipcg.tracing.sites import places, snake, use_of


def use(source: str):
    """The use of the call of `draw` in some source."""
    tree = ast.parse(source)
    parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "draw"]
    return use_of(calls[-1], parents)


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("width = draw()", "width"),
        ("self.width = 2 * draw() + 1", "width"),
        ("params['Base Radius'] = draw()", "Base Radius"),
        ("make(size=draw())", "size"),
        ("p = {'height': draw(), 'a': 1}", "height"),
        ("a, b = 1, draw()", "b"),
        ("a, b = draw()", "a_b"),
        ("x: float = draw()", "x"),
        ("kind = 1 if draw() < 0.2 else 2", "kind_case"),
        ("make(draw())", ""),
        ("_ = draw()", ""),
    ],
)
def test_a_draw_is_named_after_what_it_is_assigned_to(source, name):
    assert use(source).name == name


@pytest.mark.parametrize("body", ["return draw()", "return 2 + draw()", "v = draw()\n return v"])
def test_what_a_function_returns_is_named_by_its_caller(body):
    assert use(f"def f():\n {body}").returned


@pytest.mark.parametrize(
    ("source", "side"),
    [
        ("a = draw() < p", "<"),
        ("a = p > draw()", "<"),
        ("a = draw() >= p", ">"),
        ("a = draw()", ""),
        ("def f():\n r = draw()\n return r < 0.5 or r > 0.9", "<"),
        ("def f():\n r = draw()\n return r if r < 0.5 else 1", ""),
    ],
)
def test_a_draw_that_is_only_compared_is_a_choice(source, side):
    assert use(source).compared == side


def test_functions_that_make_a_draw_readable_are_seen():
    assert use("a = np.exp(draw(np.log(1), np.log(2)))").form == "log"
    assert use("a = np.deg2rad(draw(0, 90))").form == "degrees"
    assert use("a = np.exp(1 + draw())").form == ""


def test_a_loop_that_may_draw_again_is_seen():
    assert use("while True:\n v = draw()").retried
    assert not use("for i in range(3):\n v = draw()").retried


def test_names_work_on_a_command_line():
    assert [snake(w) for w in ("StandRadius", "Base Radius", "4th", "", "x.y")] == [
        "stand_radius",
        "base_radius",
        "n_4th",
        "",
        "x_y",
    ]


def test_a_site_is_known_by_lines_of_the_program_alone():
    found = []

    def program(seed):
        found.extend(places(sys._getframe(), test_a_site_is_known_by_lines_of_the_program_alone.__code__))

    _call_function(program, 0, {})
    names = [code.co_name for code, _ in found]
    assert names[0] == "program"
    assert "_call_function" not in names
