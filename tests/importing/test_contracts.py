"""`generators check`: each fault of a generator is named with how to mend it, and a good one passes."""

from pathlib import Path

import pytest

from dipcg.cli import main
from dipcg.importing.contracts import check
from dipcg.registry import allow_code

pytestmark = pytest.mark.slow

GENERATOR = '''
"""Triangles."""
import os, random
from dipcg.camera import ViewRange
from dipcg.space import Choice, ParameterSpace, Real

space = ParameterSpace(
    Real("size", 1.0, 2.0, unit="m", doc="of the first"),
    Choice("second", (False, True), doc="whether there is a second"),
    Real("height", 0.5, 1.0, unit="m", doc="of the second", when={when}),
{more})
{extra}
built = []

def build(params):
    built.append(params)
    size, far = params["size"], {far}
    vertices, faces = [[-size, 0, 0], [size, 0, 0], [0, 0, far]], [[0, 1, 2]]
    if params["second"]:
        vertices += [[-1, 1, 0], [1, 1, 0], [0, 1, params["height"]]]
        faces += [[3, 4, 5]]
    return vertices, faces
'''
WHEN = '{"second": (True,)}'
LOST = '    Real("lost", 0.0, 1.0, doc="lost"),\n'


def write(folder: Path, when: str = WHEN, more: str = "", extra: str = "", far: str = "1") -> str:
    path = folder / "triangles.py"
    path.write_text(GENERATOR.format(when=when, more=more, extra=extra, far=far))
    allow_code(path)
    return str(path)


def test_a_good_generator_has_no_faults(tmp_path):
    assert list(check(write(tmp_path))) == []


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"far": "random.random()"}, "build is random"),
        ({"far": "os.getpid() % 1000"}, "build is not pure: another process gives another mesh"),
        ({"far": "1 + len(built) // 2"}, "build is random"),
        ({"more": LOST}, "lost changes nothing in any trial"),
        ({"when": "{}"}, "height matters only under second = (True,); declare when={'second': (True,)}."),
        ({"when": '{"second": (False,)}'}, "The `when` of height is wrong"),
        ({"more": LOST, "far": "1 + params['lost']"}, "lost has no unit"),
        ({"far": "1e5"}, "build must return metres"),
        ({"extra": "views = ViewRange(distance=(0.01, 0.02))"}, "declare greater distances in views"),
        ({"far": "size + 0 * built[-1]['size'] / (size < 1)"}, "8 of 8 random builds failed. The first: The generator"),
        ({"extra": "mirrors = {'size': '-hieght'}"}, "mirrors names 'hieght', which is no parameter."),
    ],
)
def test_a_fault_is_named_with_how_to_mend_it(tmp_path, change, sentence):
    assert sentence in "\n".join(finding.text for finding in check(write(tmp_path, **change)))


def test_a_mirror_image_that_is_no_asset_is_named(tmp_path):
    path = Path(write(tmp_path))
    path.write_text(path.read_text().replace("[size, 0, 0]", "[2 * size, 0, 0]"))
    assert "Declare mirrors = None" in "\n".join(finding.text for finding in check(str(path)))


def test_parameters_of_large_meshes_are_tried_too(tmp_path):
    path = Path(write(tmp_path, extra="import numpy as np"))
    path.write_text(
        path.read_text().replace("vertices, faces\n", "vertices, np.repeat(faces, 400_000 // len(faces), axis=0)\n")
    )
    assert list(check(str(path))) == []


def test_the_command_says_what_to_mend_and_exits_with_1(tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        main(["generators", "check", write(tmp_path, more=LOST)])
    assert end.value.code == 1
    assert "Mend: lost changes nothing in any trial; use it in build, or take it out." in capsys.readouterr().out
    main(["generators", "check", write(tmp_path)])
    assert "keeps the contracts" in capsys.readouterr().out
