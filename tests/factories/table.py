"""Infinigen's tables. Stands get the scale of the adapter: in Infinigen they move with `top_scale`."""

import numpy as np

from dipcg.blender.infinigen import import_infinigen, read_piece

# Seeds of assets within the published ranges, of each style, with and without stretchers.
KEYS = (0, 5, 11, 12, 15, 20)
ATOL = 1e-3
VARIED = ("leg_style", "strecher_increament")


def make(key: int) -> tuple[np.ndarray, np.ndarray, dict]:
    factory = import_infinigen("infinigen.assets.objects.tables.dining_table").TableDiningFactory(key)
    if factory.params["Leg Style"] == "single_stand":
        factory.params["Leg Placement Top Relative Scale"] = 0.65
    _, vertices, faces, *_ = read_piece("table", factory.create_asset())
    return vertices, faces, {name: v for name, v in factory.params.items() if not name.endswith("Material")}


def params_of(own: dict) -> dict:
    """Our parameters from those of the factory."""
    style, x = own["Leg Style"], own["Top Profile Width"] / 1.414
    ends = [width for _, width in own["Leg Curve Control Points"] or ()]
    curve = {
        "single_stand": lambda: [(ends[0] - 0.1) / 0.8, (ends[1] - 0.1) / 0.8, (ends[2] - 0.2) / 0.8],
        "straight": lambda: [0.5, (ends[1] - 0.5) / 0.5, (ends[2] - 0.3) / 0.5],
        "square": lambda: [0.5, 0.5, 0.5],
    }[style]()
    diameter = own["Leg Diameter"]
    stands = style == "single_stand"
    return {
        "ngon": own["Top Profile N-gon"],
        "dimension_x": x,
        "dimension_y": x * own["Top Profile Aspect Ratio"],
        "dimension_z": own["Height"],
        "leg_style": style.replace("_", "-"),
        "leg_number": own["Leg Number"],
        "leg_ngon": own["Leg NGon"],
        "leg_diameter": (diameter / x - 0.2) / 0.2 if stands else (diameter - 0.05) / 0.2,
        "leg_height": own["Leg Height"],
        **{f"leg_curve_ctrl_pts{i}": value for i, value in enumerate(curve)},
        "top_scale": own["Leg Placement Top Relative Scale"],
        "bottom_scale": own["Leg Placement Bottom Relative Scale"],
        "top_thickness": own["Top Thickness"],
        "top_profile_fillet_ratio": own["Top Profile Fillet Ratio"],
        "top_vertical_fillet_ratio": own["Top Vertical Fillet Ratio"],
        "strecher_relative_pos": own["Strecher Relative Pos"],
        "strecher_increament": own["Strecher Increament"],
    }
