"""The camera convention of the project, and its matrices for OpenGL.

Azimuth 0 looks at the front (from -Y towards +Y) and grows counter-clockwise seen from above, so 90° stands at +X.
Elevation is the angle above the horizon (the paper's "elevation" is the polar angle, 90° minus this).
Distance is from the centre of the bounding box, in multiples of its longest side, so that one range fits every asset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

# Integers too, since whole degrees are what people type.
Range = tuple[float | int, float | int]

# The highest elevation either way: at 90° azimuth and roll could not be told apart.
MAX_ELEVATION_DEG = 89.0
# The distances that `encode_view` maps to the ends of [-1, 1].
NEAREST, FARTHEST = 1.5, 6.0


@dataclass(frozen=True)
class View:
    """A camera; angles in degrees, distance in longest sides of the object."""

    azimuth_deg: float
    elevation_deg: float
    distance: float = 2.5
    fov_deg: float = 35.0


@dataclass(frozen=True)
class ViewRange:
    """The views a generator is seen from in training: elevation and nearness uniform, azimuths denser in the middle.

    An azimuth is the middle plus half the range times u |u|^(concentration - 1) for a uniform u in [-1, 1]: with 1.5,
    63 % of the views of a full circle see the front, which is what people photograph.
    """

    azimuth_deg: Range = (-180.0, 180.0)
    elevation_deg: Range = (-5.0, 50.0)
    distance: Range = (1.5, 6.0)
    concentration: float = 1.5

    @property
    def middle(self) -> View:
        """The middle of every range."""
        return View(*(sum(ends) / 2 for ends in (self.azimuth_deg, self.elevation_deg, self.distance)))

    def sample(self, rng: np.random.Generator) -> View:
        """Draw one view."""
        (left, right), (low, high) = self.azimuth_deg, self.distance
        u = rng.uniform(-1, 1)
        azimuth = (left + right) / 2 + (right - left) / 2 * u * abs(u) ** (self.concentration - 1)
        return View(azimuth, rng.uniform(*self.elevation_deg), 1 / rng.uniform(1 / high, 1 / low))


@dataclass(frozen=True)
class ViewGrid:
    """Every combination of some azimuths, elevations and distances, as the paper has them."""

    azimuths_deg: tuple[float | int, ...]
    elevations_deg: tuple[float | int, ...]
    distances: tuple[float | int, ...]

    @property
    def middle(self) -> View:
        """The middle value of each; of an even number the higher of both."""
        return View(*(float(sorted(values)[len(values) // 2]) for values in self._axes))

    def sample(self, rng: np.random.Generator) -> View:
        """Draw one view."""
        return View(*(float(rng.choice(values)) for values in self._axes))

    @property
    def _axes(self) -> tuple[tuple[float | int, ...], ...]:
        return self.azimuths_deg, self.elevations_deg, self.distances


def camera_position(view: View, centre: Float[np.ndarray, "3"], side: float) -> Float[np.ndarray, "3"]:
    """The place of the camera, in metres."""
    azimuth, elevation = np.radians([view.azimuth_deg, view.elevation_deg])
    flat = np.cos(elevation)
    direction = np.array([np.sin(azimuth) * flat, -np.cos(azimuth) * flat, np.sin(elevation)])
    return np.asarray(centre, float) + direction * view.distance * side


def world_to_camera(view: View, centre: Float[np.ndarray, "3"], side: float) -> Float[np.ndarray, "4 4"]:
    """OpenGL's view matrix: the camera looks along -Z with +Y up at the centre of the object."""
    azimuth = np.radians(view.azimuth_deg)
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    back = (camera_position(view, np.zeros(3), 1.0)) / view.distance
    up = np.cross(back, right)
    rotation = np.stack([right, up, back])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ camera_position(view, centre, side)
    return matrix


def perspective(fov_deg: float, near: float, far: float) -> Float[np.ndarray, "4 4"]:
    """A square picture with the given field of view; depths in metres."""
    half = np.tan(np.radians(fov_deg) / 2)
    return frustum(-half, half, -half, half, near, far)


def frustum(left: float, right: float, bottom: float, top: float, near: float, far: float) -> Float[np.ndarray, "4 4"]:
    """OpenGL's off-centre projection; the borders are slopes (coordinate over depth), depths in metres."""
    return np.array(
        [
            [2 / (right - left), 0, (right + left) / (right - left), 0],
            [0, 2 / (top - bottom), (top + bottom) / (top - bottom), 0],
            [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, -1, 0],
        ]
    )


def fit(
    points: Float[np.ndarray, "v 3"], to_camera: Float[np.ndarray, "4 4"], margin: float = 0.06
) -> Float[np.ndarray, "4 4"]:
    """The square projection that fills the picture with the points, as `images.crop_to_object` does to a photo.

    `margin` is the share of the picture left free on either side of the longer direction.
    """
    seen = points @ to_camera[:3, :3].T + to_camera[:3, 3]
    depth = np.maximum(-seen[:, 2], 1e-6)
    slopes = seen[:, :2] / depth[:, None]
    low, high = slopes.min(0), slopes.max(0)
    centre, half = (low + high) / 2, (high - low).max() / 2 / (1 - 2 * margin)
    (left, bottom), (right, top) = centre - half, centre + half
    return frustum(left, right, bottom, top, *depth_range(depth))


def depth_range(depth: Float[np.ndarray, " v"]) -> tuple[float, float]:
    """Near and far planes around the given depths, in metres."""
    return max(float(depth.min()) * 0.9, 1e-3), float(depth.max()) * 1.1


# Numbers of a camera for the network, and for a search in a box.
VIEW_NUMBERS, BOX_NUMBERS = 4, 3


def encode_view(view: View) -> Float[np.ndarray, "4"]:
    """The camera as numbers in about [-1, 1] for the network: sine and cosine of the azimuth, elevation, nearness."""
    azimuth = np.radians(view.azimuth_deg)
    return np.array([np.sin(azimuth), np.cos(azimuth), view.elevation_deg / 60, 4 / view.distance - 5 / 3])


def decode_view(numbers: Float[np.ndarray, "4"]) -> View:
    """The camera that `encode_view` wrote, from any four numbers."""
    sine, cosine, elevation, nearness = (float(n) for n in numbers)
    distance = 4 / (min(max(nearness, -1.0), 1.0) + 5 / 3)
    highest = MAX_ELEVATION_DEG
    return View(float(np.degrees(np.arctan2(sine, cosine))), min(max(60 * elevation, -highest), highest), distance)


def view_to_box(view: View) -> Float[np.ndarray, "3"]:
    """The camera as a point of the box [-1, 1]^3 for a search: azimuth, elevation, nearness; clipped to the box."""
    numbers = [view.azimuth_deg / 180, (view.elevation_deg - 20) / 35, (1 / view.distance - 0.4) / 0.25]
    return np.clip(numbers, -1, 1)


def view_from_box(numbers: Float[np.ndarray, "3"]) -> View:
    """The camera of a point of the box, which may stand behind the object too: the inverse of `view_to_box`."""
    azimuth, elevation, nearness = (float(n) for n in numbers)
    return View(180 * azimuth, 20 + 35 * elevation, 1 / (0.4 + 0.25 * nearness))
