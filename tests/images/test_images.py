"""Reading, cutting out and cropping pictures: whatever is fed in gives a good picture or a sentence."""

import contextlib
import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dipcg import images
from dipcg.camera import View, fit, world_to_camera
from dipcg.images import MARGIN, ImageError, crop_to_object, cut_out, edges, load_image, over_white, prepare, silhouette

RED = (200, 40, 40)
REAL_PICTURES = sorted((Path(__file__).parents[3] / "shared" / "images").glob("*.png"))


def disc_mask(size: int = 120, radius: float = 30, centre: tuple = (60, 50)) -> np.ndarray:
    y, x = np.mgrid[:size, :size]
    return (x + 0.5 - centre[0]) ** 2 + (y + 0.5 - centre[1]) ** 2 < radius**2


def on(ground: np.ndarray | tuple, **disc) -> np.ndarray:
    """A red disc on a ground, opaque."""
    mask = disc_mask(**disc)
    image = np.empty((*mask.shape, 4), np.uint8)
    image[..., :3], image[..., 3] = ground, 255
    image[mask, :3] = RED
    return image


def encoded(picture: np.ndarray | Image.Image, mode: str, kind: str, **options) -> bytes:
    picture = Image.fromarray(picture) if isinstance(picture, np.ndarray) else picture
    buffer = io.BytesIO()
    picture.convert(mode).save(buffer, kind, **options)
    return buffer.getvalue()


def huge_png(side: int) -> bytes:
    """A valid header of side × side 1-bit pixels, and no pixels: what a bomb looks like before it is unpacked."""
    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"\0" * 1000)), (b"IEND", b"")]
    packed = [struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


def overlap(alpha: np.ndarray, mask: np.ndarray) -> float:
    """Intersection over union."""
    return ((alpha > 127) & mask).sum() / ((alpha > 127) | mask).sum()


WHITE = on((255, 255, 255))


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "is empty (0 bytes)"),
        (b"hello", "is not a picture in a known format"),
        (b"\0" * 100, "is not a picture in a known format"),
        (encoded(WHITE, "RGB", "JPEG")[:800], "is damaged or cut short"),
        (encoded(WHITE, "RGB", "PNG")[:200], "is damaged or cut short"),
        (encoded(WHITE, "RGB", "PNG")[:20], "is damaged or cut short"),
        (encoded(WHITE[:1, :1], "RGB", "PNG"), "has 1 × 1 pixels; at least 16 × 16"),
        (huge_png(30_000), "is too large"),
        (huge_png(8_500), "has 8500 × 8500 pixels; at most 64 million"),
    ],
    ids=["empty", "text", "zeros", "jpeg cut short", "png cut short", "png header cut", "1×1", "bomb", "too many"],
)
def test_bad_pictures_get_a_sentence(data, sentence, tmp_path):
    path = tmp_path / "photo.png"
    path.write_bytes(data)
    for source, name in ((data, "The picture"), (path, str(path))):
        with pytest.raises(ImageError) as error:
            load_image(source)
        assert str(error.value).startswith(name)
        assert sentence in str(error.value)


def test_missing_pictures_get_a_sentence(tmp_path):
    for path in (tmp_path / "none.png", str(tmp_path / "none.png"), tmp_path):
        with pytest.raises(ImageError, match="There is no picture at"):
            load_image(path)


@pytest.mark.filterwarnings("error")
def test_a_picture_just_too_large_gets_one_sentence_and_no_warning():
    with pytest.raises(ImageError, match="at most 64 million"):
        # Pillow warns from 89 million pixels on and refuses from 179 million on.
        load_image(huge_png(11_000))


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP", "GIF", "TIFF", "BMP"])
@pytest.mark.filterwarnings("ignore")
def test_damage_anywhere_gives_a_picture_or_a_sentence(kind):
    data, rng = encoded(on((255, 255, 255), size=40, radius=10, centre=(20, 20)), "RGB", kind), np.random.default_rng(0)
    for _ in range(60):
        damaged = bytearray(data[: rng.integers(1, len(data) + 1)])
        damaged[rng.integers(len(damaged))] ^= 1 << rng.integers(8)
        # No other error may leave the reader.
        with contextlib.suppress(ImageError):
            assert load_image(bytes(damaged)).shape[2] == 4


def test_an_all_white_picture_has_no_object():
    with pytest.raises(ImageError, match="No object was found"):
        prepare(np.full((64, 64, 3), 255, np.uint8), 32)


def test_a_fully_transparent_picture_has_no_object():
    image = WHITE.copy()
    image[..., 3] = 0
    with pytest.raises(ImageError, match="No object was found"):
        prepare(image, 32)


@pytest.mark.parametrize("array", [np.zeros((40, 40, 3)), np.zeros((40, 40, 2), np.uint8), np.zeros(40, np.uint8)])
def test_arrays_of_another_kind_get_a_sentence(array):
    with pytest.raises(ImageError, match="must be an array of uint8 of shape"):
        load_image(array)


@pytest.mark.parametrize(
    ("mode", "kind"),
    [("RGB", "PNG"), ("RGBA", "PNG"), ("P", "PNG"), ("P", "GIF"), ("RGB", "BMP"), ("RGBA", "TIFF"), ("CMYK", "TIFF")],
)
def test_lossless_pictures_of_every_kind_keep_their_colours(mode, kind):
    image = load_image(encoded(WHITE, mode, kind))
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(image, WHITE)


def test_cmyk_photographs_are_read_in_colour():
    image = load_image(encoded(WHITE, "CMYK", "JPEG", quality=95)).astype(int)
    assert np.abs(image - WHITE).mean() < 3
    np.testing.assert_allclose(image[50, 60, :3], RED, atol=12)


def test_grey_pictures_of_16_bits_are_scaled_not_clipped():
    deep = (np.linspace(0, 65535, 64)[None].repeat(64, 0)).astype(np.uint16)
    image = load_image(encoded_deep(deep))
    np.testing.assert_allclose(image[0, :, 0], deep[0] / 257, atol=0.51)
    np.testing.assert_array_equal(image[..., 1], image[..., 0])


def encoded_deep(deep: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(deep).save(buffer, "PNG")
    return buffer.getvalue()


def test_of_an_animation_the_first_frame_is_read():
    blue = Image.fromarray(np.full((120, 120, 3), (0, 0, 255), np.uint8))
    data = encoded(WHITE, "P", "GIF", save_all=True, append_images=[blue, Image.fromarray(WHITE)])
    assert Image.open(io.BytesIO(data)).n_frames == 3
    np.testing.assert_array_equal(load_image(data), WHITE)


def test_a_photo_taken_sideways_is_turned_upright():
    exif = Image.Exif()
    # The camera was turned: the picture is upright after a turn clockwise.
    exif[0x0112] = 6
    data = encoded(WHITE[:100], "RGB", "PNG", exif=exif)
    np.testing.assert_array_equal(load_image(data), np.rot90(WHITE[:100], -1))


def test_paths_bytes_arrays_and_open_pictures_are_read_alike(tmp_path):
    data = encoded(WHITE, "RGBA", "PNG")
    (tmp_path / "a.png").write_bytes(data)
    sources = [tmp_path / "a.png", str(tmp_path / "a.png"), data, WHITE, WHITE[..., :3], Image.fromarray(WHITE)]
    for source in sources:
        np.testing.assert_array_equal(load_image(source), WHITE)


def test_large_pictures_are_shrunk_in_proportion():
    image = load_image(np.full((1500, 3000, 3), 90, np.uint8))
    assert image.shape == (images.MAX_SIDE // 2, images.MAX_SIDE, 4)
    assert (image == [90, 90, 90, 255]).all()


def test_transparency_is_taken_as_it_is():
    image = on((0, 255, 0))
    image[..., 3] = np.where(disc_mask(), 255, 0)
    cutout = cut_out(image)
    cut, background = cutout.image, cutout.background
    assert background == "alpha"
    np.testing.assert_array_equal(cut, image)


@pytest.mark.parametrize("ground", [(255, 255, 255), (0, 0, 0), (40, 90, 200), (128, 128, 128)])
def test_a_plain_ground_is_removed_whatever_its_colour(ground):
    cutout = cut_out(on(ground))
    cut, background = cutout.image, cutout.background
    assert background == "plain"
    assert overlap(cut[..., 3], disc_mask()) > 0.95


def test_a_plain_ground_may_be_noisy():
    noisy = on((240, 240, 240)).astype(int)
    noisy[..., :3] += np.random.default_rng(0).integers(-4, 5, (120, 120, 3))
    cutout = cut_out(noisy.clip(0, 255).astype(np.uint8))
    cut, background = cutout.image, cutout.background
    assert background == "plain"
    assert overlap(cut[..., 3], disc_mask()) > 0.93


def test_the_ground_shows_through_a_hole_in_the_object():
    ring = on((255, 255, 255))
    hole = disc_mask(radius=15)
    ring[hole, :3] = 255
    alpha = cut_out(ring).image[..., 3]
    assert overlap(alpha, disc_mask() & ~hole) > 0.9


def test_a_photo_is_cut_by_its_colours():
    y, x = np.mgrid[:120, :120]
    # No two pixels of the border are alike.
    ground = np.stack([60 + x % 50, 140 + (x * y) % 60, 60 + 3 * (y % 40)], axis=-1)
    cutout = cut_out(on(ground.astype(np.uint8)))
    cut, background = cutout.image, cutout.background
    assert background == "photo"
    assert overlap(cut[..., 3], disc_mask()) > 0.85


@pytest.mark.parametrize("disc", [{"centre": (60, 50)}, {"centre": (20, 100), "radius": 15}, {"radius": 55}])
def test_the_crop_centres_the_object_and_leaves_the_margin(disc):
    cropped = crop_to_object(cut_out(on((255, 255, 255), **disc)).image, 200)
    ys, xs = np.nonzero(cropped[..., 3] > 127)
    for low, high in ((xs.min(), xs.max() + 1), (ys.min(), ys.max() + 1)):
        assert (high - low) / 200 == pytest.approx(1 - 2 * MARGIN, abs=0.05)
        assert (low + high) / 2 / 200 == pytest.approx(0.5, abs=0.02)


def test_the_crop_may_reach_beyond_the_picture():
    bar = np.zeros((20, 100, 4), np.uint8)
    bar[:, :] = (*RED, 255)
    cropped = crop_to_object(bar, 100)
    assert cropped.shape == (100, 100, 4)
    assert np.ptp(np.nonzero(cropped[..., 3] > 127)[0]) + 1 == pytest.approx(20 * (1 - 2 * MARGIN), abs=1.5)


def test_photos_are_cropped_as_training_views_are_framed():
    """The bounding box of a photo's object lands where `camera.fit` puts that of a mesh with the same outline."""
    points = np.array([[x, 0, z] for x in (-1, 1) for z in (-0.4, 0.4)], float)
    to_camera = world_to_camera(View(0.0, 0.0, distance=3.0), np.zeros(3), 2.0)
    seen = fit(points, to_camera) @ to_camera @ np.c_[points, np.ones(4)].T
    # Positions in a picture of 200 by 200 pixels.
    columns, rows = (seen[0] / seen[3] + 1) * 100, (1 - seen[1] / seen[3]) * 100
    photo = np.zeros((100, 100, 4), np.uint8)
    # The object is as wide to high as the mesh, five to two.
    photo[30:54, 20:80] = (*RED, 255)
    ys, xs = np.nonzero(crop_to_object(photo, 200)[..., 3] > 127)
    np.testing.assert_allclose([xs.min(), xs.max() + 1], [columns.min(), columns.max()], atol=1)
    np.testing.assert_allclose([ys.min(), ys.max() + 1], [rows.min(), rows.max()], atol=1)


def test_hidden_colours_do_not_bleed_into_the_crop():
    image = on((0, 255, 0))
    image[..., 3] = np.where(disc_mask(), 255, 0)
    cropped = crop_to_object(image, 50)
    np.testing.assert_allclose(cropped[cropped[..., 3] > 8][:, :3], [RED] * (cropped[..., 3] > 8).sum(), atol=2)


def test_over_white_mixes_by_alpha():
    image = np.zeros((1, 3, 4), np.uint8)
    image[0, :, 3] = [0, 128, 255]
    np.testing.assert_array_equal(over_white(image)[0, :, 0], [255, 127, 0])


def test_edges_are_dark_lines_where_the_outline_is():
    drawn = edges(cut_out(WHITE).image)
    y, x = np.nonzero(drawn[..., 0] < 128)
    distance = np.abs(np.hypot(x + 0.5 - 60, y + 0.5 - 50) - 30)
    assert len(x) > 100
    assert distance.max() < 4
    assert (drawn[..., 3] == 255).all()


def test_a_silhouette_has_one_colour_and_the_same_outline():
    cut = cut_out(WHITE).image
    shape = silhouette(cut)
    np.testing.assert_array_equal(shape[..., 3], cut[..., 3])
    assert len(np.unique(shape[..., :3])) == 1


def test_a_saved_picture_is_read_back(tmp_path):
    images.save_image(WHITE, tmp_path / "a.png")
    np.testing.assert_array_equal(load_image(tmp_path / "a.png"), WHITE)


@pytest.mark.parametrize("path", REAL_PICTURES, ids=lambda path: path.stem)
def test_real_pictures_yield_an_object(path):
    image, _ = prepare(path, 128)
    ys, xs = np.nonzero(image[..., 3] > 127)
    assert max(np.ptp(xs), np.ptp(ys)) > 0.8 * 128
    assert (image[..., 3] > 127).mean() < 0.8, "the ground is gone"
