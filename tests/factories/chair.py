"""Infinigen's chairs. The middle of the range replaces the draws of a build, as in the adapter."""

import numpy as np

from dipcg.blender.infinigen import import_infinigen, middle, read_piece, replaced
from dipcg.generators import load_generator

# Seeds of assets within the published ranges.
KEYS = (2, 3, 11, 13, 19)
VARIED = ("back_type", "is_leg_round", "has_arm", "has_leg_x_bar", "has_leg_y_bar", "is_seat_subsurf")
CHAIR = load_generator("chair")


def make(key: int) -> tuple[np.ndarray, np.ndarray, dict]:
    """The front of a chair is turned to -Y."""
    module = import_infinigen("infinigen.assets.objects.seating.chairs.chair")
    factory = module.ChairFactory(key)
    factory.seat_mid_x = (factory.seat_back + factory.seat_mid * (1 - factory.seat_back) + 1) / 2
    with replaced(module, uniform=middle):
        _, vertices, faces, *_ = read_piece("chair", factory.create_asset())
    types = (bool, int, float, str, tuple, list, np.ndarray, np.generic)
    own = {name: value for name, value in vars(factory).items() if isinstance(value, types)}
    return vertices[:, [1, 0, 2]] * [1, -1, 1], faces, own


def params_of(own: dict) -> dict:
    """Our parameters from the attributes of the factory; one without an effect may lie outside the published range."""
    width, size = own["width"], own["size"]
    params = {p.name: p.inactive for p in CHAIR.space}
    params |= {name: own[name] for name in CHAIR.space.names if name in own and not name.startswith("arm")}
    params |= {
        "bevel_width": round(own["bevel_width"] / own["thickness"], 6),
        "leg_offset_bar0": sum(own["leg_offset_bar"]) / 2,
        "leg_offset_bar1": sum(own["leg_offset_bar"]) / 2,
        "leg_x_offset": own["leg_x_offset"] / width,
        "leg_y_offset0": own["leg_y_offset"][0] / size,
        "leg_y_offset1": own["leg_y_offset"][1] / size,
        "back_x_offset": own["back_x_offset"] / width,
        "back_y_offset": own["back_y_offset"] / size,
    }
    arm = {
        "arm_thickness": own["arm_thickness"],
        "arm_height": own["arm_height"] / own["arm_thickness"],
        "arm_y": own["arm_y"] / size,
        "arm_z": own["arm_z"] / own["back_height"],
        **{f"arm_mid{i}": own["arm_mid"][i] for i in range(3)},
        **{f"arm_profile{i}": own["arm_profile"][i] for i in range(2)},
    }
    return params | (arm if own["has_arm"] else {}) | _back(own["back_type"], own["back_profile"])


def _back(back_type: str, spans: list) -> dict:
    if back_type == "partial":
        return {"back_profile_partial": spans[0][0]}
    if back_type == "vertical-bar":
        return {"back_profile_vertical": spans[0][0]}
    if back_type == "whole":
        return {}
    tops = np.array([top for _, top in spans])
    lowest = (spans[0][0] - (ratio := _ratio(spans)) * tops[0]) / (1 - ratio)
    slats = np.diff((tops - lowest) / (1 - lowest), prepend=0)
    return {
        "back_profile_horizontal_ncuts": len(spans),
        "back_profile_horizontal_ratio": ratio,
        "back_profile_horizontal_lowest": lowest,
        **{f"back_profile_horizontal_locs{i}": slat for i, slat in enumerate(slats / slats.min())},
    }


def _ratio(spans: list) -> float:
    """The gap below a slat as a share of slat and gap, from the second slat, whose gap begins where the first ends."""
    return (spans[1][0] - spans[0][1]) / (spans[1][1] - spans[0][1])
