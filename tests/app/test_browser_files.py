"""Files of assets in the page's own viewer, which is three.js: what Chromium draws of a GLB."""

import base64
from dataclasses import replace

import pytest
from browsing import shoot
from garden import COPIES, garden

from dipcg.images import load_image

# Shows a file in the viewer, and counts what three.js read: meshes, and copies that the graphics card places.
SHOW = """async (content) => {
    const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0)).buffer;
    const { GLTFLoader } = await import("/vendor/three.js"), { show } = await import("/scripts/viewer.js");
    const counts = { meshes: 0, instances: 0 };
    const { scene } = await new GLTFLoader().parseAsync(bytes.slice(0), "");
    scene.traverse((node) => {
        if (node.isInstancedMesh) counts.instances += node.count;
        else if (node.isMesh) counts.meshes += 1;
    });
    await show(bytes, { opened: 99, view: { azimuth_deg: -30, elevation_deg: 20, distance: 2.5 } });
    return counts;
}"""


@pytest.mark.parametrize("instancing", [False, True])
def test_chromium_shows_a_glb_with_each_part_in_its_colour_and_every_copy(visit, tmp_path, instancing):
    page = visit()
    page.get_by_role("button", name="Random").click()
    page.wait_for_selector("#viewer canvas[data-drawn]")
    page.wait_for_selector("body:not(.building)")
    coloured = replace(garden(spread=2.0, size=3.0), colours={"block": (0.1, 0.2, 0.8), "seed": (0.9, 0.1, 0.05)})
    path = coloured.export(tmp_path / "garden.glb", gpu_instancing=instancing)
    counts = page.evaluate(SHOW, base64.b64encode(path.read_bytes()).decode())
    assert counts == ({"meshes": 1, "instances": COPIES} if instancing else {"meshes": 1 + COPIES, "instances": 0})
    page.wait_for_timeout(300)
    shoot(page, f"garden-{'instances' if instancing else 'nodes'}")
    picture = load_image(page.locator("#viewer canvas").screenshot())[..., :3].astype(float)
    blue = (picture[..., 2] > 1.5 * picture[..., 0]).sum()
    red = (picture[..., 0] > 1.5 * picture[..., 2]).sum()
    assert blue > 10_000
    assert 0.02 < red / blue < 0.5
