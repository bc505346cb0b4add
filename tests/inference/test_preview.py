"""Pictures of several assets: they stand on one floor."""

from dataclasses import replace

import numpy as np

from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.inference.preview import same_camera


def test_where_an_asset_has_its_origin_does_not_move_it_from_the_floor(asset: Asset) -> None:
    raised = replace(asset, mesh=replace(asset.mesh, vertices=asset.mesh.vertices + np.float32([0, 0, 0.5])))
    first, second = same_camera([asset, raised], View(30.0, 20.0), 96)
    assert first.min() < 128
    assert np.abs(first.astype(int) - second).mean() < 1
