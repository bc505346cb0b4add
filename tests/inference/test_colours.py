"""The colours of a photograph on the parts of an asset."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

from dipcg.camera import View
from dipcg.images import MARGIN
from dipcg.inference.colours import photo_colours, with_colours
from dipcg.materials import check_colours, coloured, finishes, part_colours
from dipcg.mesh import Mesh, join
from dipcg.parameter_file import document_from_json
from dipcg.render import Look, Renderer
from dipcg.render.studio import draw

VIEW = View(30.0, 20.0)
# Body, leg and lid.
COLOURS = np.array([[0.8, 0.1, 0.1], [0.1, 0.2, 0.7], [0.1, 0.6, 0.2]])


@pytest.fixture(scope="module")
def photo(asset):
    renderer = Renderer(256)
    order = [("body", "leg", "lid").index(name) for name in asset.mesh.part_names]
    picture = renderer.render(asset.mesh, VIEW, Look(COLOURS[order], strengths=np.zeros(2), ambient=1.0), MARGIN)
    renderer.close()
    return picture, COLOURS[order]


def test_each_part_gets_the_colour_that_the_photo_shows_there(asset, photo):
    found = photo_colours(photo[0], asset.mesh, VIEW)
    np.testing.assert_allclose([found[part] for part in asset.mesh.part_names], photo[1], atol=0.02)


WOOD, RED, WHITE = (0.6, 0.4, 0.2), (0.8, 0.1, 0.1), (1.0, 1.0, 1.0)


def stool(bar_z: float = 0.0) -> Mesh:
    """A leg, a seat, and a thin bar at some height."""
    blocks = {"leg": [0.1, 0.1, 1.0], "bar": [0.9, 0.02, 0.02], "seat": [1.0, 1.0, 0.2]}
    places = {"leg": [0, 0, 0], "bar": [0.5, 0, bar_z], "seat": [0.2, 0, 0.7]}
    solids = [trimesh.creation.box(size) for size in blocks.values()]
    return join([(part, box.vertices + places[part], box.faces) for part, box in zip(blocks, solids, strict=True)])


def picture_of(mesh: Mesh, shown: dict[str, tuple[float, float, float]]) -> np.ndarray:
    renderer, look = Renderer(256), np.array([shown[part] for part in mesh.part_names])
    picture = renderer.render(mesh, VIEW, Look(look, strengths=np.zeros(2), ambient=1.0), MARGIN)
    renderer.close()
    return picture


def test_a_thin_part_beside_its_picture_has_no_colour_of_its_own():
    """A bar of which the photograph shows the ground, and the legs that it belongs to."""
    mesh = stool()
    picture = picture_of(mesh, {"leg": WOOD, "bar": WHITE, "seat": RED})
    found = photo_colours(picture, mesh, VIEW, "chair")
    assert set(found) == {"leg", "seat"}
    np.testing.assert_allclose(found["leg"], WOOD, atol=0.02)
    # Parts of which nobody knows what they are made of are no kin.
    assert set(photo_colours(picture, mesh, VIEW, "")) == {"leg", "bar", "seat"}


@pytest.mark.parametrize("ground", [(1.0, 1.0, 1.0), (0.35, 0.5, 0.65)])
@pytest.mark.parametrize("off", [-0.05, 0.04])
@pytest.mark.parametrize("generator", ["", "chair"])
def test_a_thin_part_beside_its_picture_takes_nothing_of_ground_that_the_cut_out_left(ground, off, generator):
    picture = picture_of(stool(off), {"leg": WOOD, "bar": WOOD, "seat": RED})
    rows, columns = np.nonzero(picture[..., 3])
    left = np.zeros(picture.shape[:2], bool)
    left[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
    # As a cut-out that keeps all ground around the bar, in a soft shadow.
    alpha = picture[..., 3:] / 255
    picture[..., :3] = np.rint(picture[..., :3] * alpha + 255 * 0.95 * np.array(ground) * (1 - alpha))
    picture[..., 3] = np.where(left, 255, 0)
    found = photo_colours(picture, stool(), VIEW, generator, ground)
    for part in found.keys() & {"leg", "bar"}:
        np.testing.assert_allclose(found[part], WOOD, atol=0.03)
    assert "leg" in found
    assert "bar" in found or generator == "chair"


def chair(off: float = 0.0) -> Mesh:
    """A thick back, and two thin legs of the same family that may stand a little beside their place."""
    back, leg = trimesh.creation.box([0.7, 0.1, 0.5]), trimesh.creation.box([0.027, 0.027, 0.6])
    legs = [leg.vertices + [side + off, 0, -0.5] for side in (-0.3, 0.3)]
    return join([("back", back.vertices, back.faces), *(("leg", vertices, leg.faces) for vertices in legs)])


@pytest.mark.parametrize("off", [0.0, 0.02, 0.04])
def test_thin_legs_of_a_chair_have_their_own_colour_where_the_ground_can_be_told(off):
    picture = picture_of(chair(), {"back": (0.8, 0.75, 0.7), "leg": RED})
    np.testing.assert_allclose(photo_colours(picture, chair(off), VIEW, "chair", WHITE)["leg"], RED, atol=0.03)


def test_an_object_as_pale_as_the_ground_keeps_its_colour():
    mesh, pale = stool(), (0.97, 0.96, 0.95)
    found = photo_colours(picture_of(mesh, dict.fromkeys(mesh.part_names, pale)), mesh, VIEW, "chair", WHITE)
    assert set(found) >= {"leg", "seat"}
    np.testing.assert_allclose(list(found.values()), [pale] * len(found), atol=0.01)


def test_a_part_that_is_not_seen_has_no_colour_of_its_own(asset, photo):
    hidden = asset.mesh.part_names.index("lid")
    small = replace(asset.mesh, vertices=asset.mesh.vertices.copy())
    small.vertices[np.unique(small.faces[small.parts == hidden])] = small.centre
    assert "lid" not in photo_colours(photo[0], small, View(30.0, -80.0))


def test_a_part_without_a_colour_looks_like_its_family_or_else_like_all():
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    seat, leg, arm = coloured("chair", ("seat", "leg", "arm"), {"seat": red, "leg": blue})
    assert (seat.colour, leg.colour) == (red, blue)
    np.testing.assert_allclose(arm.colour, blue)
    assert seat.name == "seat_fabric"
    (cushion,) = coloured("chair", ("seat",), {"leg": red, "back": blue})
    # Half the light of each.
    np.testing.assert_allclose(cushion.colour, [0.7354, 0, 0.7354], atol=1e-4)


def test_without_a_photo_parts_have_the_colours_of_materials(asset):
    names = asset.mesh.part_names
    assert with_colours(asset).materials == finishes("box", names)
    assert dict(with_colours(asset, colours="parts").colours) == part_colours(names)
    red = replace(asset, colours={"lid": (1.0, 0.0, 0.0)})
    assert with_colours(red) is red
    assert with_colours(red, colours="material").materials == finishes("box", names)


def test_a_parameter_file_keeps_the_colours_and_needs_none(asset, tmp_path):
    red = replace(asset, colours={"lid": (0.9, 0.05, 0.05)})
    document = document_from_json(red.save_params(tmp_path / "red.json").read_text())
    assert check_colours(document["colours"]) == red.colours
    assert document["params"] == asset.params
    assert "colours" not in document_from_json(asset.save_params(tmp_path / "plain.json").read_text())


@pytest.mark.parametrize(
    "colours", [3, [1, 0, 0], {"lid": "red"}, {"lid": [1, 0]}, {"lid": [1, 0, 2]}, {"lid": [1, 0, float("nan")]}]
)
def test_what_is_no_colour_gets_a_sentence(colours):
    with pytest.raises(ValueError, match="Colours of parts are numbers from 0 to 1"):
        check_colours(colours)


def test_the_studio_shows_materials_and_a_shadow_on_the_floor(asset):
    red = tuple(replace(one, colour=(0.9, 0.05, 0.05)) for one in asset.materials)
    picture = draw(asset.mesh, red, VIEW, 96)
    body = picture[picture[..., 3] == 255][:, :3].astype(int)
    assert (body[:, 0] > body[:, 1] + 20).mean() > 0.9
    shadow = picture[(picture[..., 3] > 20) & (picture[..., 3] < 200)]
    assert len(shadow) > 100
    assert (shadow[:, :3].max(1) < 128).mean() > 0.5


def test_the_shadow_on_the_floor_has_no_stripes(asset):
    # Each of its lights has a hard edge of its own.
    alpha = draw(asset.mesh, asset.materials, VIEW, 192)[..., 3].astype(int)
    floor = cv2.erode((alpha < 200).astype(np.uint8), np.ones((5, 5))) > 0
    across = np.abs(np.diff(alpha, axis=1))[floor[:, 1:] & floor[:, :-1]]
    assert alpha[floor].max() > 60
    assert across.max() < 12
