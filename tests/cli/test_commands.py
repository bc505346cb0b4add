"""The command line: bad input gets one sentence and exit code 1, before any work and without a traceback."""

import json
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

import dipcg.generators
from dipcg import registry
from dipcg.cli import main
from dipcg.cli.assets import parse_settings
from dipcg.config import ModelConfig
from dipcg.generators import load_generator
from dipcg.model.checkpoint import save_checkpoint
from dipcg.model.estimators import Estimator
from dipcg.model.zoo import shipped
from dipcg.workers import pool as worker

TINY = ModelConfig(width=16, depth=1, heads=2, summary=16)
PARAMS = {"width": 0.5, "depth": 0.6, "height": 0.7, "top": "open", "lid_height": 0.3, "overhang": 0.075}
PARAMS |= {"has_legs": True, "leg_height": 0.2}


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def untrained(tmp_path_factory) -> Path:
    """A checkpoint that knows nothing: enough for all that can go wrong around it."""
    torch.manual_seed(0)
    folder, box = tmp_path_factory.mktemp("checkpoint"), load_generator("box")
    save_checkpoint(folder, Estimator(box.space, TINY), box, {})
    return folder


@pytest.fixture
def picture() -> Path:
    pixels = np.full((64, 64, 3), 255, np.uint8)
    pixels[16:48, 20:44] = [150, 90, 40]
    Image.fromarray(pixels).save("picture.png")
    return Path("picture.png")


@pytest.fixture
def no_builds(monkeypatch) -> Iterator[None]:
    """What is refused must be refused before a worker is started."""
    started: list[str] = []
    monkeypatch.setattr(worker.Child, "__init__", lambda _, ref: started.append(ref))
    yield
    assert started == []


def run(capsys, *words: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of one command in this process."""
    code = 0
    try:
        main([str(word) for word in words])
    except SystemExit as end:
        code = end.code
    out, err = capsys.readouterr()
    return code, out, err


def sentence(capsys, *words: object) -> str:
    """The one short line on stderr of a command that must fail with exit code 1."""
    code, out, err = run(capsys, *words)
    assert (code, out) == (1, "")
    assert err.count("\n") == 1, err
    assert err[0].isalpha() or err[0] in "/'"
    assert err.strip()[-1] in ".?"
    assert len(err) < 300
    assert "Traceback" not in err
    assert "Errno" not in err
    return err.strip()


# Generators and parameters


@pytest.mark.parametrize(
    "words",
    ["sample chiar -o c.glb", "generators chiar", "estimate picture.png -g chiar -o c.glb", "evaluate chiar --data .",
     "dataset build chiar -o data"],
)  # fmt: skip
def test_an_unknown_generator_gets_the_nearest_name(capsys, picture, no_builds, words):
    assert "There is no generator 'chiar'. Did you mean 'chair'?" in sentence(capsys, *words.split())


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("widht=0.5", "There is no parameter 'widht'. Did you mean 'width'?"),
        ("width=7", "width must be a number from 0.3 to 1 m, got '7'."),
        ("width=nan", "width must be a number from 0.3 to 1 m, got 'nan'."),
        ("width=wide", "width must be a number from 0.3 to 1 m, got 'wide'."),
        ("width=", "width must be a number from 0.3 to 1 m, got ''."),
        ("top=piramid", "top must be one of open, flat, pyramid, got 'piramid'. Did you mean 'pyramid'?"),
        ("has_legs=2", "has_legs must be one of False, True, got '2'."),
        ("width", "A setting is written name=value, got 'width'."),
    ],
)
def test_a_wrong_setting_is_named(capsys, untrained, picture, no_builds, setting, expected):
    Path("box.json").write_text(box_with())
    assert sentence(capsys, "sample", "box", "-o", "a.glb", "--set", setting) == expected
    assert sentence(capsys, "edit", "box.json", "-o", "a.glb", "--set", setting) == expected
    assert sentence(capsys, "estimate", picture, "-g", untrained, "-o", "a.glb", "--keep", setting) == expected
    assert not Path("a.glb").exists()


def test_two_values_for_one_parameter_are_refused(capsys, untrained, picture, no_builds):
    words = ["-o", "a.glb", "--keep", "top=open", "--keep", "top=flat"]
    expected = "top is given twice, as open and as flat; give it once."
    assert sentence(capsys, "estimate", picture, "-g", untrained, *words) == expected


def test_what_would_do_nothing_cannot_be_held(capsys, untrained, picture, no_builds):
    words = ["-o", "a.glb", "--keep", "top=flat", "lid_height=0.2"]
    expected = "lid_height does nothing when top is flat; hold only one of the two, or top at pyramid."
    assert sentence(capsys, "estimate", picture, "-g", untrained, *words) == expected


@pytest.mark.parametrize("seconds", ["0", "-3", "nan"])
def test_a_search_needs_time(capsys, untrained, picture, no_builds, seconds):
    said = sentence(capsys, "estimate", picture, "-g", untrained, "-o", "a.glb", "--refine", seconds)
    assert said == f"A search (--refine) takes more than 0 seconds, got {seconds}."


def test_settings_may_share_a_flag_or_have_one_each(capsys):
    assert parse_settings([["a=1", "b = x=y"], ["c="]]) == {"a": "1", "b": "x=y", "c": ""}
    words = ["sample", "box", "-o", "a.stl", "--json", "--set", "width=0.5", "depth=0.6", "--set", "top=open"]
    code, out, _ = run(capsys, *words)
    assert code == 0
    made = json.loads(out)["params"]
    assert (made["width"], made["depth"], made["top"]) == (0.5, 0.6, "open")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("space = 3\ndef build(params): ...", "must define `space`, a ParameterSpace, and a function `build`"),
        ("build = lambda params: None", "must define `space`"),
        ("import no_such", "stool.py cannot be loaded, ModuleNotFoundError: No module named 'no_such'."),
        ("space = (", "stool.py cannot be loaded, SyntaxError"),
        ("space = Parameters()", "stool.py cannot be loaded, NameError: name 'Parameters' is not defined."),
        (None, "There is no file stool.py"),
    ],
)
def test_a_file_that_is_no_generator_gets_a_sentence(capsys, no_builds, text, expected):
    if text is not None:
        Path("stool.py").write_text(text)
    for words in ("sample ./stool.py -o a.glb", "generators stool.py", "dataset build ./stool.py -o data"):
        assert expected in sentence(capsys, *words.split())


def test_a_generator_by_path_is_estimated_from_its_run_in_this_folder(capsys, untrained, picture):
    said = sentence(capsys, "estimate", picture, "-g", "./stool.py", "-o", "a.glb")
    assert "no trained checkpoint for './stool.py'" in said
    assert "dipcg train ./stool.py" in said
    Path("runs").mkdir()
    Path("runs/stool").symlink_to(untrained)
    words = ["estimate", picture, "-g", "./stool.py", "-o", "a.glb", "--candidates", 1, "--steps", 1]
    assert run(capsys, *words)[0] == 0


# Pictures


def png_that_claims(width: int, height: int) -> bytes:
    """The start of a PNG file with a given size and no pixels."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))


def encoded(pixels: np.ndarray) -> bytes:
    Image.fromarray(pixels).save("pixels.png")
    return Path("pixels.png").read_bytes()


BAD_PICTURES = {
    "missing": (lambda: None, "There is no picture at bad.png"),
    "zero bytes": (lambda: b"", "bad.png is empty (0 bytes)"),
    "text": (lambda: b"a chair, roughly", "bad.png is not a picture"),
    "cut short": (
        lambda: encoded(np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8))[:2000],
        "bad.png is damaged or cut short",
    ),
    "one pixel": (lambda: encoded(np.zeros((1, 1, 3), np.uint8)), "bad.png has 1 × 1 pixels"),
    "huge": (lambda: png_that_claims(30_000, 30_000), "bad.png"),
    "white": (lambda: encoded(np.full((64, 64, 3), 255, np.uint8)), "No object was found"),
    "transparent": (lambda: encoded(np.zeros((64, 64, 4), np.uint8)), "No object was found"),
}


@pytest.mark.parametrize(("make", "expected"), BAD_PICTURES.values(), ids=BAD_PICTURES)
def test_a_picture_that_cannot_be_used_is_named(capsys, untrained, make, expected):
    data = make()
    if data is not None:
        Path("bad.png").write_bytes(data)
    said = sentence(capsys, "estimate", "bad.png", "-g", untrained, "-o", "a.glb")
    assert expected in said
    assert "bad.png" in said
    assert not Path("a.glb").exists()


def test_a_folder_is_no_picture(capsys, untrained):
    Path("pictures").mkdir()
    assert "pictures" in sentence(capsys, "estimate", "pictures", "-g", untrained, "-o", "a.glb")


def test_no_picture_at_all(capsys, untrained):
    assert sentence(capsys, "estimate", "-g", untrained, "-o", "a.glb") == "Give at least one picture."


@pytest.mark.parametrize("flag", ["--candidates", "--steps"])
def test_numbers_below_one_are_refused(capsys, untrained, picture, flag):
    assert "must be at least 1" in sentence(capsys, "estimate", picture, "-g", untrained, "-o", "a.glb", flag, 0)


# Outputs


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("a.max", "a.max has no known ending; use one of .glb, .gltf, .obj, .ply, .stl, .usdz"),
        ("a", "a has no known ending"),
        ("no/such/a.glb", "The folder no/such does not exist; make it first"),
        ("folder.glb", "folder.glb cannot be written (Is a directory)."),
        ("picture.png/a.glb", "picture.png"),
    ],
)
def test_an_output_that_cannot_be_written_is_refused_before_any_work(
    capsys, untrained, picture, no_builds, output, expected
):
    Path("folder.glb").mkdir()
    Path("box.json").write_text(box_with())
    for words in (["sample", "box"], ["edit", "box.json"], ["estimate", picture, "-g", untrained]):
        assert expected in sentence(capsys, *words, "-o", output)


@pytest.mark.parametrize(
    ("flag", "path"), [("--params-out", "a.txt"), ("--preview", "a.jpg"), ("--preview", "no/a.png")]
)
def test_the_other_outputs_are_checked_as_early(capsys, untrained, picture, no_builds, flag, path):
    said = sentence(capsys, "estimate", picture, "-g", untrained, "-o", "a.glb", flag, path)
    assert "no known ending" in said or "does not exist" in said


def test_a_contact_sheet_and_a_table_are_checked_as_early(capsys, untrained):
    assert "does not exist" in sentence(capsys, "dataset", "gallery", "nowhere", "-o", "no/a.png")
    assert "no known ending" in sentence(capsys, "evaluate", untrained, "--data", "nowhere", "--json", "table.csv")


def test_no_picture_is_overwritten_and_no_result_written_twice(capsys, untrained, picture, no_builds):
    before = picture.read_bytes()
    into = ["-g", untrained, "-o", "a.glb", "--preview"]
    would = "would be overwritten; choose another name or folder."
    assert sentence(capsys, "estimate", picture, *into, picture) == f"picture.png {would}"
    assert sentence(capsys, "estimate", picture, "other/picture.png", *into[:-1]) == f"picture.png.glb {would}"
    assert sentence(capsys, "estimate", picture, "b.png", *into, "sheet.png") == f"picture.png {would}"
    assert picture.read_bytes() == before


# Parameter files


def box_with(**changes: object) -> str:
    return json.dumps({"generator": "box", "params": PARAMS | changes})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{", "A parameter file is JSON like"),
        ("[]", "A parameter file is JSON like"),
        ("", "A parameter file is JSON like"),
        ('{"params": {}}', "A parameter file is JSON like"),
        ('{"generator": "box", "params": 3}', "A parameter file is JSON like"),
        ('{"generator": "bxo", "params": {}}', "There is no generator 'bxo'. Did you mean 'box'?"),
        ('{"generator": "box", "params": {}}', "These parameters are missing: width, depth"),
        (box_with(hight=1), "There is no parameter 'hight'. Did you mean 'height'?"),
        (box_with(width=9), "width must be a number"),
        (box_with(width="wide"), "width must be a number"),
    ],
)
def test_a_broken_parameter_file_gets_a_sentence(capsys, no_builds, text, expected):
    Path("box.json").write_text(text)
    assert expected in sentence(capsys, "edit", "box.json", "-o", "a.glb")


def test_a_parameter_file_that_cannot_be_read(capsys, no_builds):
    Path("noise.json").write_bytes(bytes(range(256)))
    assert "noise.json cannot be read as a parameter file" in sentence(capsys, "edit", "noise.json", "-o", "a.glb")
    assert "none.json cannot be read as a parameter file" in sentence(capsys, "edit", "none.json", "-o", "a.glb")


# What is not there


def test_infinigen_not_installed(capsys, monkeypatch, no_builds):
    monkeypatch.setattr(dipcg.generators, "find_spec", lambda name: None)
    for words in (["sample", "chair", "-o", "a.glb"], ["dataset", "build", "chair", "-o", "data", "--count", 1]):
        assert "'chair' needs infinigen and bpy: run `pip install" in sentence(capsys, *words)
    assert list(Path().iterdir()) == []


def test_a_generator_without_a_checkpoint(capsys, monkeypatch, picture, tmp_path):
    monkeypatch.setattr("dipcg.model.zoo.SHIPPED", tmp_path / "none")
    said = sentence(capsys, "estimate", picture, "-g", "box", "-o", "a.glb")
    assert "There is no trained checkpoint for 'box'" in said
    assert "dipcg train box" in said


@pytest.mark.parametrize("command", ["info nowhere", "gallery nowhere -o a.png"])
def test_a_folder_that_is_no_data_set(capsys, command):
    assert sentence(capsys, "dataset", *command.split()).startswith("nowhere is not a data set")
    assert sentence(capsys, "train", "box", "--data", "nowhere").startswith("nowhere is not a data set")


def test_a_command_that_does_not_exist_is_a_wrong_command_line(capsys):
    code, _, err = run(capsys, "sampel", "box")
    assert code == 2
    assert "sampel" in err
    assert "Traceback" not in err


# Listings


def test_generators_are_listed_with_parameters_and_whether_they_can_be_estimated(capsys):
    code, out, err = run(capsys, "generators", "--json")
    assert (code, err) == (0, "")
    listed = {row["name"]: row for row in json.loads(out)}
    assert list(listed) == registry.names("generators")
    for name, row in listed.items():
        assert row["parameters"] == len(load_generator(name).space)
        assert row["estimates"] == (name in shipped())


def test_a_checkpoint_in_the_package_makes_its_generator_estimable(capsys, monkeypatch, untrained, tmp_path):
    (tmp_path / "box").symlink_to(untrained)
    monkeypatch.setattr("dipcg.model.zoo.SHIPPED", tmp_path)
    rows = json.loads(run(capsys, "generators", "--json")[1])
    assert {row["name"]: row["estimates"] for row in rows} == {
        name: name == "box" for name in registry.names("generators")
    }


def test_the_parameters_of_a_generator_are_listed(capsys):
    described = json.loads(run(capsys, "generators", "box", "--json")[1])
    assert [entry["name"] for entry in described] == load_generator("box").space.names
    lines = run(capsys, "generators", "box")[1].splitlines()
    for parameter in load_generator("box").space:
        assert any(parameter.name in line and parameter.doc in line for line in lines)
