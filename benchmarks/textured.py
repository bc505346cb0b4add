"""Baked maps as another program shows them: `python -m benchmarks.textured OUT.png [NAME SEED]...` draws a row of GLBs.

Each asset is baked, written as GLB, read back by Blender and drawn with Cycles; the seconds of baking are printed.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.export.textures import texture
from dipcg.images import MARGIN, over_white, save_image
from dipcg.workers.pool import BuildPool
from dipcg.workers.rpc import Blender

ASSETS = ["chair", "10", "chair", "8", "table", "6", "vase", "5"]
SIZE, FACES, SIDE, SAMPLES, VIEW = 512, 30_000, 384, 32, View(30.0, 20.0)


def main(out: str, assets: list[str]) -> None:
    tiles = []
    with tempfile.TemporaryDirectory() as folder, Blender() as blender:
        for name, seed in zip(assets[::2], map(int, assets[1::2]), strict=True):
            path = str(_textured(name, seed).export(Path(folder) / f"{name}{seed}.glb"))
            image = blender.call("scene:photograph_file", path, seed, VIEW, SIDE, SAMPLES, MARGIN)
            tiles.append(over_white(image))
    save_image(np.concatenate(tiles, 1), out)


def _textured(name: str, seed: int) -> Asset:
    with BuildPool(name) as pool:
        params = pool.generator.space.sample(np.random.default_rng(seed))
        asset = Asset(pool.build(params), name, params).with_faces(FACES)
    started = time.perf_counter()
    made = texture(asset, SIZE, seed)
    print(
        f"{name} {seed}: {len(asset.mesh.faces):,} triangles baked at {SIZE}² in {time.perf_counter() - started:.0f} s"
    )
    return made


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:] or ASSETS)
