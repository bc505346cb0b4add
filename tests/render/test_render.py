"""Pictures of meshes: silhouettes against closed forms and Blender's own, colours, light, and repeatability."""

import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy.spatial import ConvexHull

from dipcg.camera import View, camera_position, perspective, world_to_camera
from dipcg.generators import load_generator
from dipcg.images import MARGIN, crop_to_object
from dipcg.mesh import Mesh, join
from dipcg.render import Look, Renderer, sample_look
from dipcg.workers.pool import BuildPool

SIZE = 128
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
VIEWS = [
    View(0.0, 0.0),
    View(30.0, 20.0),
    View(-120.0, 45.0, 2.2),
    View(200.0, -5.0, distance=5.0, fov_deg=20.0),
]
ASIDE = VIEWS[1]
# Light that leaves colours as they are.
FLAT = {"lights": np.array([[0.0, 0.0, 1.0]]), "strengths": np.zeros(1), "ambient": 1.0}
WHITE = Look(np.ones((1, 3)), **FLAT)

every_view = pytest.mark.parametrize("view", VIEWS, ids=lambda view: f"{view.azimuth_deg}, {view.elevation_deg}")


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    renderer = Renderer(SIZE)
    yield renderer
    renderer.close()


def block(name: str = "body", size: tuple = (1.0, 0.7, 0.5), at: tuple = (0.0, 0.0, 0.0)) -> tuple:
    corners = CORNERS * size + at
    return name, corners, ConvexHull(corners).simplices


def pixels(points: np.ndarray, mesh: Mesh, view: View, size: int = SIZE) -> np.ndarray:
    """Where points in metres lie in the picture, in pixels right and down from its upper left corner."""
    seen = np.c_[points, np.ones(len(points))] @ world_to_camera(view, mesh.centre, mesh.side).T
    clip = seen @ perspective(view.fov_deg, 0.01, 100.0).T
    return (clip[:, :2] / clip[:, 3:] * [1, -1] + 1) / 2 * size


def colour_at(picture: np.ndarray, point: np.ndarray) -> np.ndarray:
    column, row = np.floor(point).astype(int)
    return picture[row, column, :3].astype(float)


def mask(picture: np.ndarray) -> np.ndarray:
    return (picture[..., 3] > 127).astype(np.uint8)


def agree_within_a_pixel(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether each mask, and each background, lies within the other one grown by a pixel."""
    kernel = np.ones((3, 3), np.uint8)
    pairs = [(a, b), (b, a), (1 - a, 1 - b), (1 - b, 1 - a)]
    return all((inner <= cv2.dilate(outer, kernel)).all() for inner, outer in pairs)


@every_view
def test_the_silhouette_of_a_box_is_the_hull_of_its_projected_corners(renderer, view):
    mesh = join([block()])
    hull = ConvexHull(pixels(mesh.vertices, mesh, view))
    centres = np.stack(np.meshgrid(np.arange(SIZE), np.arange(SIZE)), -1) + 0.5
    # The distances from the hull in pixels, negative inside.
    outside = (centres @ hull.equations[:, :2].T + hull.equations[:, 2]).max(-1)
    alpha = renderer.render(mesh, view)[..., 3]
    assert (alpha[outside < -1] == 255).all()
    assert (alpha[outside > 1] == 0).all()
    assert alpha.sum() / 255 == pytest.approx(hull.volume, rel=0.01), "partly covered pixels count as such"


@every_view
def test_alpha_is_straight(renderer, view):
    picture = renderer.render(join([block()]), view, WHITE)
    edge = (picture[..., 3] > 0) & (picture[..., 3] < 255)
    assert edge.sum() > 20
    assert picture[edge][:, :3].min() >= 250, "a white object stays white where it half covers a pixel"
    assert (picture[picture[..., 3] == 0] == 0).all()


def test_each_part_has_its_colour_and_colours_repeat(renderer):
    places = [(-0.8, 0.0, 0.0), (0.0, 0.0, 0.0), (0.8, 0.0, 0.0)]
    mesh = join([block(name, (0.5, 0.5, 0.5), at) for name, at in zip("abc", places, strict=True)])
    shuffled = np.random.default_rng(0).permutation(len(mesh.faces))
    mesh = Mesh(mesh.vertices, mesh.faces[shuffled], mesh.parts[shuffled], mesh.part_names)
    picture = renderer.render(mesh, View(0.0, 0.0), Look(np.array([[1.0, 0.0, 0.0], [0.2, 0.6, 1.0]]), **FLAT))
    found = [colour_at(picture, point) for point in pixels(np.array(places), mesh, View(0.0, 0.0))]
    np.testing.assert_allclose(found, [[255, 0, 0], [51, 153, 255], [255, 0, 0]], atol=1)


@pytest.mark.parametrize("light", [(0.0, 0.0, 1.0), (1.0, 0.3, 0.2), (-0.4, 0.8, 0.1)], ids=str)
def test_brightness_follows_the_cosine_between_face_and_light(renderer, light):
    """The root of ambient plus strength times cosine; a light from the camera makes faces towards it brighter."""
    mesh, view, look = join([block()]), View(35.0, 25.0), Look(np.ones((1, 3)), np.array([light]), np.array([0.6]), 0.2)
    # The front, right and top sides, which this view sees.
    faces = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    picture = renderer.render(mesh, view, look)
    middles = pixels(faces * mesh.bounds[1], mesh, view)
    turned = faces @ world_to_camera(view, mesh.centre, mesh.side)[:3, :3].T
    cosines = (turned @ light / np.linalg.norm(light)).clip(0)
    found = np.array([colour_at(picture, middle)[0] for middle in middles])
    np.testing.assert_allclose(found, 255 * np.sqrt(0.2 + 0.6 * cosines), atol=2)
    assert light != (0.0, 0.0, 1.0) or (np.argsort(found) == np.argsort(turned[:, 2])).all()


def test_grain_changes_colours_and_not_the_outline(renderer):
    mesh = join([block()])
    plain, grained = (renderer.render(mesh, ASIDE, Look(grain=np.array([grain]))) for grain in (0.0, 0.5))
    np.testing.assert_array_equal(plain[..., 3], grained[..., 3])
    inside = plain[..., 3] == 255
    assert grained[inside].std(0)[:3].min() > plain[inside].std(0)[:3].min() + 1


@every_view
def test_a_margin_crops_as_the_preparation_of_pictures_does(renderer, view):
    mesh = join([block(), block("post", (0.1, 0.1, 1.2), (0.3, 0.0, 0.2))])
    large = Renderer(512)
    cropped = crop_to_object(np.ascontiguousarray(large.render(mesh, view)), SIZE, MARGIN)
    large.close()
    assert agree_within_a_pixel(mask(renderer.render(mesh, view, margin=MARGIN)), mask(cropped))


def test_two_renders_are_equal_whatever_was_drawn_between(renderer):
    box, other = join([block()]), join([block(size=(0.2, 0.2, 1.0)), block("lid", at=(0, 0, 1))])
    look = sample_look(np.random.default_rng(3), 1)
    first = renderer.render(box, ASIDE, look)
    renderer.render(other, View(70.0, 5.0), sample_look(np.random.default_rng(4), 2), MARGIN)
    np.testing.assert_array_equal(renderer.render(box, ASIDE, look), first)


def test_renderers_do_not_disturb_each_other(renderer):
    """One in another thread, one beside it in this one."""
    mesh = join([block()])
    first = renderer.render(mesh, ASIDE)
    with ThreadPoolExecutor(1) as thread:
        elsewhere = thread.submit(lambda: Renderer(SIZE).render(mesh, ASIDE)).result()
    np.testing.assert_array_equal(elsewhere, first)
    beside = Renderer(SIZE // 2)
    assert beside.render(mesh, ASIDE).shape == (SIZE // 2, SIZE // 2, 4)
    np.testing.assert_array_equal(renderer.render(mesh, ASIDE), first)
    beside.close()
    np.testing.assert_array_equal(renderer.render(mesh, ASIDE), first)


FORK = """
import os
from dipcg.camera import View
from dipcg.mesh import make_mesh
from dipcg.render import Renderer

triangle = make_mesh([[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 2]])
Renderer(16).render(triangle, View(0.0, 0.0))
child = os.fork()
if child:
    os.waitpid(child, 0)
else:
    try:
        Renderer(16).render(triangle, View(0.0, 0.0))
    except RuntimeError as error:
        print(error, flush=True)
    os._exit(0)
"""


def test_a_fork_of_a_process_that_rendered_gets_a_sentence_and_does_not_hang():
    done = subprocess.run([sys.executable, "-c", FORK], capture_output=True, text=True, timeout=120)
    assert done.stdout.startswith("This process was forked from one that had rendered"), done.stderr


# Blender's own picture

BLENDER = """
import sys
import bpy, numpy as np
from mathutils import Vector

given = np.load(sys.argv[1])
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
mesh = bpy.data.meshes.new("mesh")
mesh.from_pydata(given["vertices"].tolist(), [], given["faces"].tolist())
scene.collection.objects.link(bpy.data.objects.new("mesh", mesh))
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.angle = float(given["fov"])
camera.data.clip_start = 0.01
camera.location = given["position"]
camera.rotation_mode = "QUATERNION"
camera.rotation_quaternion = Vector(given["centre"] - given["position"]).to_track_quat("-Z", "Y")
scene.collection.objects.link(camera)
scene.camera = camera
scene.render.engine = "CYCLES"
scene.cycles.samples, scene.cycles.use_denoising = 16, False
scene.cycles.pixel_filter_type = "BOX"
scene.render.film_transparent = True
scene.render.resolution_x = scene.render.resolution_y = int(given["size"])
scene.render.image_settings.color_mode = "RGBA"
scene.render.filepath = sys.argv[2]
bpy.ops.render.render(write_still=True)
"""


def blender_mask(mesh: Mesh, view: View, folder: Path) -> np.ndarray:
    position = camera_position(view, mesh.centre, mesh.side)
    camera = {"position": position, "centre": mesh.centre, "fov": np.radians(view.fov_deg), "size": SIZE}
    np.savez(folder / "scene.npz", vertices=mesh.vertices, faces=mesh.faces, **camera)
    command = [sys.executable, "-c", BLENDER, str(folder / "scene.npz"), str(folder / "scene.png")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (folder / "scene.png").is_file(), done.stdout + done.stderr
    return mask(np.asarray(Image.open(folder / "scene.png")))


def light_mesh(name: str) -> Mesh:
    generator = load_generator(name)
    if generator.missing:
        pytest.skip(f"{' and '.join(generator.missing)} not installed")
    with BuildPool(name) as pool:
        return pool.build(generator.space.sample(np.random.default_rng(1)), "light")


@pytest.mark.blender
@pytest.mark.skipif(find_spec("bpy") is None, reason="bpy not installed")
@pytest.mark.parametrize(("name", "view"), [("box", View(40.0, 30.0)), ("chair", View(-35.0, 15.0, distance=1.8))])
def test_the_silhouette_is_that_of_blender(renderer, tmp_path, name, view):
    mesh = light_mesh(name)
    ours, theirs = mask(renderer.render(mesh, view)), blender_mask(mesh, view, tmp_path)
    assert 0.1 < theirs.mean() < 0.9
    assert agree_within_a_pixel(ours, theirs)
