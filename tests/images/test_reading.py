"""Files that people have: each kind is read upright once, with values that can be seen, or refused in a sentence."""

import io
import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from dipcg.images import ImageError, cut_out, load_image, read_image
from dipcg.images.formats import FORMATS, SUFFIXES

CASES = Path(__file__).parents[3] / "shared" / "cases"
BROWN, RED, GREY = (120, 90, 60), (200, 30, 20), (240, 240, 240)


def block(height: int = 96, width: int = 64) -> np.ndarray:
    """A brown block with a red one on its left top, on light grey."""
    image = np.empty((height, width, 3), np.uint8)
    image[:] = GREY
    image[16:80, 16:48] = BROWN
    image[16:32, 16:32] = RED
    return image


def saved(picture: Image.Image, kind: str, **options) -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, kind, **options)
    return buffer.getvalue()


def box_of(alpha: np.ndarray) -> tuple[int, int, int, int]:
    """Left, right, top and bottom of what is opaque."""
    ys, xs = np.nonzero(alpha > 127)
    return int(xs.min()), int(xs.max()), int(ys.min()), int(ys.max())


# As a camera stores a scene for each orientation (EXIF 2.3, section 4.6.4).
STORED = {
    1: lambda upright: upright,
    2: lambda upright: upright[:, ::-1],
    3: lambda upright: upright[::-1, ::-1],
    4: lambda upright: upright[::-1],
    5: lambda upright: upright.swapaxes(0, 1),
    6: lambda upright: np.rot90(upright, 1),
    7: lambda upright: np.rot90(upright.swapaxes(0, 1), 2),
    8: lambda upright: np.rot90(upright, -1),
}


@pytest.mark.parametrize("orientation", STORED)
@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("JPEG", {"quality": 95, "subsampling": 0}),
        ("PNG", {}),
        ("WEBP", {"lossless": True}),
        ("TIFF", {}),
        ("TIFF", {"compression": "tiff_lzw"}),
        ("AVIF", {"quality": 95}),
    ],
    ids=lambda value: value if isinstance(value, str) else "".join(map(str, value.values())),
)
@pytest.mark.parametrize("height", [96, 64], ids=["upright", "square"])
def test_every_orientation_is_turned_once(orientation, kind, options, height):
    upright = block()[:height]
    exif = Image.Exif()
    exif[0x0112] = orientation
    data = saved(Image.fromarray(np.ascontiguousarray(STORED[orientation](upright))), kind, exif=exif, **options)
    image = load_image(data)[..., :3]
    assert image.shape == upright.shape
    assert np.abs(image.astype(int) - upright).mean() < 3


@pytest.mark.parametrize(
    ("dtype", "brightest", "kind"),
    [
        (np.uint8, 1, "PNG"),
        (np.uint8, 2, "PNG"),
        (np.uint16, 1, "PNG"),
        (np.uint16, 255, "PNG"),
        (np.uint16, 4095, "PNG"),
        (np.uint16, 65535, "PNG"),
        (np.uint16, 1023, "TIFF"),
        (np.int32, 4095, "TIFF"),
        (np.float32, 1.0, "TIFF"),
        (np.float32, 0.01, "TIFF"),
        (np.float32, 255.0, "TIFF"),
    ],
)
def test_values_of_any_range_become_a_picture_whose_object_is_found(dtype, brightest, kind):
    grey = np.full((96, 64), brightest, dtype)
    grey[16:80, 16:48] = brightest // 4 if dtype != np.float32 else brightest / 4
    cutout = cut_out(saved(Image.fromarray(grey), kind))
    assert np.abs(np.subtract(box_of(cutout.image[..., 3]), (16, 47, 16, 79))).max() <= 1


@pytest.mark.parametrize("scale", [1, 16, 257])
def test_colours_of_16_bits_keep_what_is_in_their_lower_bits(scale):
    data = cv2.imencode(".png", block()[..., ::-1].astype(np.uint16) * scale)[1].tobytes()
    assert np.abs(load_image(data)[..., :3].astype(int) - block()).max() <= 1


def test_what_is_no_number_does_not_count():
    values = np.full((96, 64), 0.9, np.float32)
    values[16:80, 16:48] = 0.2
    values[0, :3] = np.nan, np.inf, -np.inf
    assert (
        np.abs(
            np.subtract(box_of(cut_out(saved(Image.fromarray(values), "TIFF")).image[..., 3]), (16, 47, 16, 79))
        ).max()
        <= 1
    )


@pytest.mark.parametrize("mode", ["1", "L", "RGB", "I;16", "F", "CMYK"])
def test_a_picture_that_is_black_all_over_is_said(mode):
    black = Image.new("RGB", (40, 40)).convert(mode) if mode in ("CMYK", "RGB") else Image.new(mode, (40, 40))
    with pytest.raises(ImageError, match="is black all over"):
        load_image(saved(black, "TIFF"))


def test_a_black_object_that_is_cut_out_is_none_of_these():
    image = np.zeros((40, 40, 4), np.uint8)
    image[10:30, 10:30, 3] = 255
    np.testing.assert_array_equal(cut_out(image).image, image)


@pytest.mark.parametrize("ending", ["rounded corners", "a thin frame", "a row"])
def test_transparency_that_trims_corners_or_edges_is_no_cut_out(ending):
    image = np.dstack([block(192, 128), np.full((192, 128), 255, np.uint8)])
    if ending == "rounded corners":
        y, x = np.mgrid[:192, :128]
        away = np.maximum(0, np.stack([8 - x, x - 119, 8 - y, y - 183])).max(0) ** 2
        corner = np.minimum(np.minimum(x, 127 - x), 8) + np.minimum(np.minimum(y, 191 - y), 8)
        image[(corner < 5) | (away > 64)] = 0
    elif ending == "a thin frame":
        image[:3], image[-3:], image[:, :3], image[:, -3:] = 0, 0, 0, 0
    else:
        image[-4:] = 0
    cutout = cut_out(image)
    assert cutout.background == "plain"
    left, right, top, bottom = box_of(cutout.image[..., 3])
    assert (right - left, bottom - top) == (31, 63)


def test_of_a_file_with_several_pages_the_first_is_read_and_this_is_said():
    pages = [Image.fromarray(block()), Image.new("RGB", (64, 96), "red"), Image.new("RGB", (64, 96))]
    for kind in ("TIFF", "GIF", "WEBP", "PNG"):
        image, notes = read_image(saved(pages[0], kind, save_all=True, append_images=pages[1:]))
        assert image.shape == (96, 64, 4), kind
        assert notes == ("The picture has several frames or pages; the first is used.",), kind
        assert read_image(saved(pages[0], kind)).notes == ()


POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 100 100\n%%EndComments\nshowpage\n"


@pytest.mark.parametrize("data", [POSTSCRIPT, b"%PDF-1.4\n", b"<svg xmlns='http://www.w3.org/2000/svg'/>"])
def test_other_files_are_refused_before_a_program_is_started(data, monkeypatch):
    monkeypatch.setattr(subprocess, "check_call", lambda *_, **__: pytest.fail("Ghostscript was started"))
    with pytest.raises(ImageError, match="not a picture in a known format"):
        load_image(data)


def test_an_icon_that_hides_a_large_picture_is_not_opened():
    png = saved(Image.new("1", (9000, 9000)), "PNG")
    icon = struct.pack("<HHH", 0, 1, 1) + struct.pack("<BBBBHHII", 16, 16, 0, 0, 1, 32, len(png), 22) + png
    with pytest.raises(ImageError, match="not a picture in a known format"):
        load_image(icon)


@pytest.mark.parametrize("kind", ["HEIF", "AVIF"])
def test_pictures_of_phones_are_read(kind):
    if kind == "HEIF":
        pytest.importorskip("pillow_heif").register_heif_opener()
    image = load_image(saved(Image.fromarray(block()), kind, quality=95))
    assert np.abs(image[..., :3].astype(int) - block()).mean() < 4


@pytest.mark.parametrize(
    ("brand", "sentence"),
    [(b"heic", "is a HEIC picture; install pillow-heif"), (b"avif", "is an AVIF picture, which this Pillow cannot")],
)
def test_without_a_decoder_a_sentence_says_what_to_install(brand, sentence, monkeypatch):
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    monkeypatch.setattr("dipcg.images.formats.FORMATS", [name for name in FORMATS if name not in ("HEIF", "AVIF")])
    with pytest.raises(ImageError, match=sentence):
        load_image(struct.pack(">I", 24) + b"ftyp" + brand + b"\0" * 40)


def test_every_format_has_an_ending():
    known = {Image.registered_extensions().get(ending) for ending in SUFFIXES} - {None}
    assert known <= set(FORMATS)


MEMORY = """
import resource, sys
from dipcg.images import load_image
import cv2
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
load_image(sys.argv[1])
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["grey of 16 bits", "palette"])
def test_the_largest_pictures_need_little_more_memory_than_their_pixels(kind, tmp_path):
    large = np.zeros((8000, 8000), np.uint16 if kind == "grey of 16 bits" else np.uint8)
    large[2000:6000, 2000:6000] = 200
    picture = Image.fromarray(large) if kind == "grey of 16 bits" else Image.fromarray(large).convert("P")
    picture.save(tmp_path / "large.png", compress_level=1)
    del large
    done = subprocess.run([sys.executable, "-c", MEMORY, tmp_path / "large.png"], capture_output=True, text=True)
    assert int(done.stdout) < 300, done.stderr


needs_cases = pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is not here")


@needs_cases
def test_case_of_a_tiff_with_an_orientation():
    image = load_image(CASES / "exif6.tif")
    assert image.shape == (300, 200, 4)
    reddest = np.argwhere(image[..., 0].astype(int) - image[..., 1] > 80)
    assert (reddest.mean(0) < [150, 100]).all()


@needs_cases
@pytest.mark.parametrize("name", ["i16_255.png", "i16_12bit.png", "float01.tif", "rounded_corners.png"])
def test_case_of_a_block(name):
    assert np.abs(np.subtract(box_of(cut_out(CASES / name).image[..., 3]), (50, 139, 40, 279))).max() <= 1


@needs_cases
def test_case_of_a_mask():
    mask = np.asarray(Image.open(CASES / "mask01.png")) == 1
    found = cut_out(CASES / "mask01.png").image[..., 3] > 127
    assert (found & mask).sum() / (found | mask).sum() > 0.98
