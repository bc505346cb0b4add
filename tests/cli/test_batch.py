"""A folder of pictures: what is there is skipped, what fails is shown, the page lists all."""

import os
from pathlib import Path

import numpy as np
import pytest
from serving import box_checkpoint

from dipcg.cli import main
from dipcg.cli.batch import BatchError, open_batch
from dipcg.images import save_image


@pytest.fixture
def pictures(tmp_path) -> Path:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in ("b.jpg", "a.PNG", "<c> & d.webp", "notes.txt"):
        (folder / name).write_bytes(b"")
    return folder


def finish(files) -> None:
    for path in (files.asset, files.params, files.preview):
        path.write_bytes(b"x")


def test_pictures_of_one_name_keep_their_ending_and_pictures_of_phones_are_taken(tmp_path):
    for name in ("IMG_1.HEIC", "a.png", "a.jpg", "a.png.jpg", "b.avif", "c.gif", "d.mov"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "older").mkdir()
    batch = open_batch(tmp_path, tmp_path / "out")
    names = {picture.name: files.asset.name for picture, files in batch.files.items()}
    assert names == {
        "IMG_1.HEIC": "IMG_1.glb",
        "a.png": "a.png.glb",
        "a.jpg": "a.jpg.glb",
        "a.png.jpg": "a.png.jpg.glb",
        "b.avif": "b.glb",
        "c.gif": "c.glb",
    }
    assert [path.name for path in batch.others] == ["d.mov", "older"]


def test_all_pictures_wait_at_first_and_other_files_are_named(pictures, tmp_path):
    batch = open_batch(pictures, tmp_path / "out" / "deep")
    assert [path.name for path in batch.others] == ["notes.txt"]
    assert [path.name for path in batch.waiting] == ["<c> & d.webp", "a.PNG", "b.jpg"]
    assert batch.files[pictures / "b.jpg"].asset == tmp_path / "out/deep/b.glb"


def test_what_is_complete_is_skipped_and_what_lacks_a_file_is_not(pictures, tmp_path):
    batch = open_batch(pictures, tmp_path / "out")
    finish(batch.files[pictures / "a.PNG"])
    batch.files[pictures / "b.jpg"].asset.write_bytes(b"stopped after this")
    again = open_batch(pictures, tmp_path / "out")
    assert [path.name for path in again.waiting] == ["<c> & d.webp", "b.jpg"]


def test_the_page_has_every_picture_with_its_files_or_its_problem(pictures, tmp_path):
    batch = open_batch(pictures, tmp_path / "out", ".usdz")
    finish(batch.files[pictures / "a.PNG"])
    text = batch.write_page({pictures / "<c> & d.webp": "It is <empty>."}).read_text()
    assert "1 of 3 pictures, 1 failed" in text
    assert '<a href="a.usdz">' in text
    assert 'src="a.preview.png"' in text
    assert "&lt;c&gt; &amp; d.webp" in text
    assert "It is &lt;empty&gt;." in text
    assert "<c>" not in text
    assert "<empty>" not in text
    assert text.count("<article") == 3


@pytest.mark.parametrize(
    ("names", "out", "expected"),
    [
        ([], "out", "has no pictures; they end in .png"),
        (["a.png"], ".", "holds the pictures; choose another folder"),
        (["a.png"], "a.png", "cannot be made"),
    ],
)
def test_a_folder_that_cannot_be_worked_through_is_refused(tmp_path, names, out, expected):
    for name in names:
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(BatchError, match=expected):
        open_batch(tmp_path, tmp_path / out)


def test_a_name_that_is_no_utf8_stops_nothing_and_is_printed(tmp_path, capsys):
    (tmp_path / "pictures").mkdir()
    square = np.full((64, 64, 3), 255, np.uint8)
    square[16:48, 16:48] = 60
    save_image(square, tmp_path / "pictures" / "b.png")
    for name in (b"a\xff.png", b"c\xfe.png"):
        (tmp_path / "pictures" / os.fsdecode(name)).write_bytes((tmp_path / "pictures" / "b.png").read_bytes())
    (tmp_path / "pictures" / os.fsdecode(b"d\xfd.png")).write_bytes(b"no picture")
    words = ["estimate", tmp_path / "pictures", "-g", box_checkpoint(tmp_path / "box"), "-o", tmp_path / "out"]
    with pytest.raises(SystemExit) as end:
        main([*map(str, words), "--candidates", "1", "--steps", "1"])
    said = capsys.readouterr()
    assert end.value.code == 1
    assert r"d\udcfd.png" in said.err
    assert [line.count("->") for line in said.out.splitlines()] == [1, 1, 1]
    made = {os.fsencode(path.name) for path in (tmp_path / "out").glob("*.glb")}
    assert made == {b"a\xff.glb", b"b.glb", b"c\xfe.glb"}
    page = (tmp_path / "out" / "index.html").read_text()
    assert 'href="a%FF.glb"' in page
    assert "3 of 4 pictures, 1 failed" in page
