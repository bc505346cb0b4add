"""Infinigen's vases. The factory draws the size before it sets its own seed, so a seed is set before."""

import numpy as np

from dipcg.blender.infinigen import import_infinigen, read_piece
from dipcg.mesh import Mesh

# Seeds of assets within the published ranges, smooth and fluted.
KEYS = (3, 12, 15)
VARIED = ("profile_inner_radius",)


def make(key: int) -> tuple[np.ndarray, np.ndarray, dict]:
    """A corner of a vase is turned to the front, as in the adapter."""
    module = import_infinigen("infinigen.assets.objects.table_decorations.vase")
    np.random.seed(key)  # noqa: NPY002
    factory = module.VaseFactory(key)
    _, vertices, faces, *_ = read_piece("vase", factory.create_asset())
    own = {name: value for name, value in factory.params.items() if name != "Material"}
    return np.stack([vertices[:, 1], -vertices[:, 0], vertices[:, 2]], axis=1), faces, own


def params_of(own: dict) -> dict:
    """Our parameters from those of the factory."""
    neck = own["Neck Scale"]
    return {
        "dimension_x": own["Diameter"],
        "dimension_z": own["Height"],
        "neck_scale": neck,
        "profile_inner_radius": own["Profile Inner Radius"],
        "profile_star_points": own["Profile Star Points"],
        "top_scale": own["Top Scale"] / neck,
        "neck_mid_position": own["Neck Mid Position"],
        "neck_position": own["Neck Position"] - 0.5 * neck - 0.5,
        "shoulder_position": own["Shoulder Position"],
        "shoulder_thickness": own["Shoulder Thickness"],
        "foot_scale": own["Foot Scale"],
        "foot_height": own["Foot Height"],
    }


def check(ours: Mesh, theirs: Mesh) -> None:
    """All vertices and faces are the same."""
    np.testing.assert_allclose(ours.vertices, theirs.vertices, atol=1e-5)
    np.testing.assert_array_equal(ours.faces, theirs.faces)
