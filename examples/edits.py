"""One chair and six edits of it, each a change of one or two parameters: `python examples/edits.py OUT.png`.

The same as `dipcg edit chair.json --set has_arm=0 -o no_arms.glb --preview before_after.png`, and so on.
"""

import sys

import cv2
import numpy as np

from dipcg.camera import View
from dipcg.export.asset import Asset
from dipcg.generators import load_generator
from dipcg.images import save_image
from dipcg.inference.preview import same_camera
from dipcg.workers.pool import BuildPool

CHAIR = {
    "width": 0.5,
    "size": 0.45,
    "thickness": 0.05,
    "leg_height": 0.42,
    "leg_thickness": 0.03,
    "leg_type": "straight",
}
CHAIR |= {
    "leg_x_offset": 0.03,
    "leg_y_offset0": 0.03,
    "leg_y_offset1": 0.05,
    "has_leg_x_bar": True,
    "has_leg_y_bar": True,
}
CHAIR |= {
    "has_arm": True,
    "arm_thickness": 0.03,
    "arm_y": 0.95,
    "arm_z": 0.5,
    "back_height": 0.45,
    "back_type": "vertical-bar",
}
CHAIR |= {"back_vertical_cuts": 3, "back_y_offset": 0.12, "is_seat_round": False, "is_leg_round": False}
EDITS = {
    "the chair": {},
    "no arms": {"has_arm": False},
    "short arms": {"arm_y": 0.5},
    "thick legs": {"leg_thickness": 0.065},
    "taller": {"leg_height": 0.75},
    "whole back": {"back_type": "whole"},
    "wider": {"width": 0.78},
}
VIEW, SIDE, CAPTION = View(35.0, 20.0), 320, 40


def main(out: str) -> None:
    chair = load_generator("chair")
    start = chair.space.replace(chair.space.sample(np.random.default_rng(0)), CHAIR)
    with BuildPool("chair") as pool:
        every = [chair.space.replace(start, change) for change in EDITS.values()]
        assets = [Asset(pool.build(params, "standard"), "chair", params) for params in every]
    tiles = same_camera(assets, VIEW, SIDE)
    save_image(np.concatenate([captioned(*pair) for pair in zip(tiles, EDITS, strict=True)], 1), out)


def captioned(tile: np.ndarray, text: str) -> np.ndarray:
    below = np.full((CAPTION, SIDE, 3), 255, np.uint8)
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.7, 1)
    place = ((SIDE - width) // 2, CAPTION - 15)
    cv2.putText(below, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7, (30, 30, 30), 1, cv2.LINE_AA)
    return np.concatenate([tile, below])


if __name__ == "__main__":
    main(sys.argv[1])
