"""Seeded programs as generators: what `dipcg generators add` makes of small programs, and what it refuses."""

import time

import numpy as np
import pytest

from dipcg.generators import load_generator
from dipcg.importing.seeded import import_program
from dipcg.importing.survey import Runner, survey
from dipcg.mesh import Mesh
from dipcg.registry import CodeError, allow_code
from dipcg.space import Real
from dipcg.tracing.programs import full_name
from dipcg.workers.pool import BuildPool

TOWER = '''
"""A tower of boxes."""
import numpy as np
from numpy.random import choice, randint, uniform

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)])
SIDES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [1, 5, 7]]


def tower(seed):
    np.random.seed(seed)
    width = uniform(0.5, 1.0)
    roof = choice(["flat", "spire"])
    has_door = uniform() < 0.3
    color = uniform(0, 1, 3)
    unused = uniform(0, 1)
    boxes, top = [], 0.0
    for _ in range(randint(1, 4)):
        height = uniform(0.2, 0.4)
        boxes.append((width, height, top))
        top += height
    if roof == "spire":
        steep = np.exp(uniform(np.log(0.2), np.log(2.0)))
        boxes.append((uniform(0.1, width), steep, top))
    if has_door:
        boxes.append((door(), 0.1, -0.1))
    points = [CORNERS * (w, w, h) + (0, 0, z) for w, h, z in boxes]
    faces = [np.array(SIDES) + 8 * i for i in range(len(boxes))]
    return np.concatenate(points), np.concatenate(faces)


def door():
    width = np.random.normal(1.5, 0.1)
    return width
'''


# A file without a public function, to add one to.
TRIANGLE = """
import numpy as np
from numpy.random import uniform

def _triangle(width):
    return [[0, 0, 0], [width, 0, 0], [0, width, width]], [[0, 1, 2]]

def _wide(width):
    return _triangle(width + uniform(0, 0.1))

"""


@pytest.fixture(scope="module")
def tower(tmp_path_factory):
    file = tmp_path_factory.mktemp("program") / "tower.py"
    file.write_text(TOWER)
    return import_program(str(file), "tower")


def test_draws_become_parameters_with_the_names_and_ranges_of_the_source(tower):
    space = load_generator(str(tower.path)).space
    declared = {p.name: (p.low, p.high) if isinstance(p, Real) else p.options for p in space}
    assert declared == {
        "width": (0.5, 1.0),
        "roof": ("flat", "spire"),
        "has_door": (False, True),
        "tower_18": (1, 2, 3),
        "height_1": (0.2, 0.4),
        "height_2": (0.2, 0.4),
        "height_3": (0.2, 0.4),
        "steep": pytest.approx((0.2, 2.0)),
        "tower_24": (0.0, 1.0),
        "width_2": pytest.approx((1.3, 1.7)),
    }


def test_draws_that_are_not_always_made_say_when(tower):
    space = load_generator(str(tower.path)).space
    assert {p.name: dict(p.when) for p in space if p.when} == {
        "height_2": {"tower_18": (2, 3)},
        "height_3": {"tower_18": (3,)},
        "steep": {"roof": ("spire",)},
        "tower_24": {"roof": ("spire",)},
        "width_2": {"has_door": (True,)},
    }


def test_draws_without_effect_and_for_materials_are_named_with_the_reason(tower):
    assert tower.left_out == {
        "color_x, color_y, color_z": "drawn for a material",
        "unused": "no effect on the mesh",
    }


def test_the_mesh_follows_from_the_parameters_alone(tower):
    space = load_generator(str(tower.path)).space
    many = [space.sample(np.random.default_rng(seed)) for seed in range(4)]
    with BuildPool(str(tower.path)) as one, BuildPool(str(tower.path)) as other:
        for params, mesh in zip(many, map(one.build, many), strict=True):
            np.testing.assert_array_equal(other.build(params).vertices, mesh.vertices)
            assert np.ptp(mesh.vertices[:8, 0]) == pytest.approx(params["width"], abs=1e-6)
            assert mesh.vertices[:8, 2].max() == pytest.approx(params["height_1"], abs=1e-6)
            boxes = params["tower_18"] + (params["roof"] == "spire") + params["has_door"]
            assert len(mesh.vertices) == 8 * boxes


def test_a_file_that_only_data_names_runs_no_program(tower, tmp_path):
    (tmp_path / "tower.py").write_text(TOWER)
    (tmp_path / "given.toml").write_text(tower.path.read_text())
    with pytest.raises(CodeError, match="--allow-code"):
        load_generator(str(tmp_path / "given.toml"))


def test_a_person_may_delete_a_parameter_and_rename_another(tower, tmp_path):
    (tmp_path / "tower.py").write_text(TOWER)
    text = tower.path.read_text().replace("[parameters.width]", "[parameters.breadth]")
    start = text.index("[parameters.steep]")
    edited = tmp_path / "edited.toml"
    edited.write_text(text[:start] + text[text.index("[parameters", start + 1) :])
    allow_code(edited)
    generator = load_generator(str(edited))
    assert "breadth" in generator.space
    assert "steep" not in generator.space
    with BuildPool(generator) as pool:
        assert isinstance(pool.build(generator.space.sample(np.random.default_rng(0))), Mesh)


def test_a_program_that_has_changed_is_refused(tower, tmp_path):
    (tmp_path / "tower.py").write_text(TOWER + "\n# new\n")
    (tmp_path / "tower.toml").write_text(tower.path.read_text())
    allow_code(tmp_path / "tower.toml")
    with pytest.raises(ValueError, match="has changed since"):
        load_generator(str(tmp_path / "tower.toml"))


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ("def make(seed, width, depth):\n    return None", "needs the arguments width, depth"),
        ("import time\ndef make(seed):\n    return _wide(time.time() % 1)", "uses the clock"),
        ("import os\ndef make(seed):\n    return _wide(1 + os.urandom(1)[0])", "os.urandom"),
        ("import os\ndef make(seed):\n    return _wide(1 + 1e-6 * os.urandom(1)[0])", "ties by chance"),
        ("import os\ndef make(seed):\n    os.fork()", "a copy of its process"),
        ("def make(seed):\n    for _ in range(10000): uniform()", "more than 5,000 times"),
        ("def make(seed):\n    return _wide(float(input('width? ')))", "asks for input"),
        ("def make(seed):\n    return 1 / 0", "ZeroDivisionError"),
        ("def make(seed):\n    return 'a tower'", "returned a str"),
        ("def make(seed):\n    return _triangle(1)", "no draw that can be a parameter"),
        ("def make(seed):\n    import os\n    os._exit(3)", "died"),
        ("def make(seed):\n    raise SystemExit(1)", "ends its process with sys.exit"),
        ("def make(seed):\n    return [[0, 0, 0], [1, 1, uniform()]], [[0, 1]]", "three corners or more"),
        ("import nowhere_to_be_found\ndef make(seed): pass", "No module named 'nowhere_to_be_found'"),
        ("def other(seed): pass\ndef more(seed): pass", "--function"),
        ("def make(:", "no Python"),
    ],
    ids=lambda text: text.splitlines()[-1].strip()[:30],
)
def test_a_program_that_cannot_be_recorded_gets_a_sentence(body, sentence, tmp_path):
    file = tmp_path / "program.py"
    file.write_text(TRIANGLE + body + "\n")
    with pytest.raises(ValueError, match=sentence):
        import_program(str(file), output=tmp_path / "made.toml")
    assert not (tmp_path / "made.toml").exists()


@pytest.mark.parametrize(("name", "sentence"), [("", "Name one of"), ("NoFactory", "none of its modules has one")])
def test_a_factory_that_is_not_there_gets_a_sentence(name, sentence):
    pytest.importorskip("infinigen")
    with pytest.raises(ValueError, match=sentence):
        full_name(f"infinigen:{name}")


def test_a_program_that_hangs_is_stopped(tmp_path):
    file = tmp_path / "program.py"
    file.write_text("def make(seed):\n    while True:\n        pass\n")
    with Runner(f"{file}:make", 0, {}, timeout_s=1.0) as runner, pytest.raises(ValueError, match="longer than 1 s"):
        survey(runner, time.monotonic() + 3)


@pytest.mark.parametrize("signature", ["rng", "rng: np.random.Generator", "state: 'np.random.RandomState'", "seed=0"])
def test_a_function_may_take_a_generator_or_a_seed(signature, tmp_path):
    file = tmp_path / "program.py"
    name = signature.partition(":")[0].partition("=")[0]
    draw = f"np.random.default_rng({name}).uniform(1, 2)" if name == "seed" else f"{name}.uniform(1, 2)"
    file.write_text(f"{TRIANGLE}def make({signature}):\n    w = {draw}\n    return _triangle(w)\n")
    assert import_program(str(file)).parameters == ["w"]


def test_a_draw_that_a_later_choice_makes_idle_says_when(tmp_path):
    file = tmp_path / "rug.py"
    body = "def make(seed):\n    length, size = uniform(1, 2), uniform(2, 3)\n    is_long = uniform() < 0.5\n"
    file.write_text(TRIANGLE + body + "    return _triangle(length * size if is_long else size)\n")
    space = load_generator(str(import_program(str(file)).path)).space
    assert {p.name: dict(p.when) for p in space} == {"length": {"is_long": (True,)}, "size": {}, "is_long": {}}


def test_arguments_can_be_given(tmp_path):
    file = tmp_path / "program.py"
    file.write_text(f"{TRIANGLE}def make(seed, low):\n    w = uniform(low, 2)\n    return _triangle(w)\n")
    made = import_program(str(file), arguments={"low": 0.5})
    (parameter,) = load_generator(str(made.path)).space
    assert isinstance(parameter, Real)
    assert (parameter.low, parameter.high) == (0.5, 2)
