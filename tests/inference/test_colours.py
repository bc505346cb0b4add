"""The colours of a photograph on the parts of an asset."""

from dataclasses import replace

import numpy as np
import pytest

from dipcg.camera import View
from dipcg.images import MARGIN
from dipcg.inference.colours import photo_colours, with_colours
from dipcg.materials import finishes, part_finishes
from dipcg.render import Look, Renderer
from dipcg.studio import draw

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
    np.testing.assert_allclose([found[part] for part in range(3)], photo[1], atol=0.02)


def test_a_part_that_is_not_seen_gets_the_colour_of_what_is(asset, photo):
    from_below = View(30.0, -80.0)
    hidden = asset.mesh.part_names.index("lid")
    small = replace(asset.mesh, vertices=asset.mesh.vertices.copy())
    small.vertices[np.unique(small.faces[small.parts == hidden])] = small.centre
    found = photo_colours(photo[0], small, from_below)
    assert max(found[hidden]) > 0.1


def test_without_a_photo_parts_have_the_colours_of_materials(asset):
    assert with_colours(asset, "photo").finishes == finishes("box", asset.mesh.part_names)
    assert with_colours(asset, "parts").finishes == part_finishes(asset.mesh.part_names)


def test_the_studio_shows_materials_and_a_shadow_on_the_floor(asset):
    red = tuple(replace(one, colour=(0.9, 0.05, 0.05)) for one in asset.materials)
    picture = draw(asset.mesh, red, VIEW, 96)
    body = picture[picture[..., 3] == 255][:, :3].astype(int)
    assert (body[:, 0] > body[:, 1] + 20).mean() > 0.9
    shadow = picture[(picture[..., 3] > 20) & (picture[..., 3] < 200)]
    assert len(shadow) > 100
    assert (shadow[:, :3].max(1) < 128).mean() > 0.5
