"""Pictures of an object on a ground as photographs have them: rooms, textures, clutter, studios, shadows.

All that is drawn here is drawn at random with a few calls of OpenCV, about a millisecond for each picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

RGBA = UInt8[np.ndarray, "h w 4"]
Ground = Float32[np.ndarray, "s s 3"]
Photograph = Float32[np.ndarray, "_ _ 3"]
Plane = Float32[np.ndarray, "s s"]
Rng = np.random.Generator


class Scene(NamedTuple):
    """A picture, and the share of each pixel that the object covers."""

    picture: UInt8[np.ndarray, "s s 3"]
    coverage: Plane


def sample_scene(views: Sequence[RGBA], size: int, rng: Rng, photographs: Sequence[Photograph] = ()) -> Scene:
    """One of the views on a random ground, somewhere in a square picture, with a shadow and the faults of a camera."""
    ground = sample_ground(size, rng, photographs)
    view = _placed(views[rng.integers(len(views))], size, rng)
    colour, coverage = _recoloured(view[..., :3], ground, view[..., 3], rng), view[..., 3]
    picture = _shaded(ground, coverage, rng)
    picture += (colour - picture) * (coverage * _glass(coverage, rng))[..., None]
    return Scene(_photographed(picture, rng), coverage)


def sample_ground(size: int, rng: Rng, photographs: Sequence[Photograph] = ()) -> Ground:
    """A random ground in [0, 1]; with photographs (in [0, 1], of any size) every sixth is a piece of one."""
    kinds: list[Callable[[int, Rng], Ground]] = [studio, studio, clouds, planks, tiles, clutter, room, room, room]
    if photographs and rng.random() < 1 / 6:
        return _piece(photographs[rng.integers(len(photographs))], size, rng)
    return _lit(kinds[rng.integers(len(kinds))](size, rng), rng)


def studio(size: int, rng: Rng) -> Ground:
    """One colour, most often nearly white, that grows darker towards one side or the corners."""
    light = rng.random() < 0.6
    base = np.full(3, rng.uniform(0.85, 1)) if light else rng.uniform(0.05, 0.95, 3)
    across, down = _axes(size)
    slope = rng.normal(size=2) * (0.02 if light else 0.1)
    corners = rng.uniform(0, 0.25) * (rng.random() < 0.4) * (across**2 + down**2)
    return _colours(slope[0] * across + slope[1] * down - corners, base + rng.normal(size=3) * 0.01)


def clouds(size: int, rng: Rng) -> Ground:
    """Noise of several scales between two colours: plaster, stone, cloth, leaves."""
    share = _noise(size, rng, rng.uniform(0.35, 0.9))[..., None]
    one, other = _two_colours(rng)
    return (one + (other - one) * share).astype(np.float32)


def planks(size: int, rng: Rng) -> Ground:
    """Boards with a grain."""
    rows, grain = rng.integers(2, 12), _noise(size, rng, 0.7)
    across, down = _axes(size)
    turned = across if rng.random() < 0.4 else down
    board = np.floor((turned + 1) / 2 * rows).astype(int)
    shade = rng.normal(size=rows + 2) * rng.uniform(0, 0.12)
    stretched = np.asarray(cv2.resize(grain[: max(2, size // 8)], (size, size)), np.float32)
    joint = np.abs((turned + 1) / 2 * rows % 1 - 0.5) > 0.48
    base = rng.uniform([0.25, 0.15, 0.05], [0.9, 0.75, 0.6])
    return _colours(shade[board] + 0.25 * (stretched - 0.5) - rng.uniform(0, 0.25) * joint, base)


def tiles(size: int, rng: Rng) -> Ground:
    """Checks, bricks or a pattern of two colours."""
    across, down = _axes(size)
    turn, rows = rng.choice([0.0, rng.uniform(0, np.pi)]), rng.uniform(2, 14)
    u, v = np.cos(turn) * across + np.sin(turn) * down, np.cos(turn) * down - np.sin(turn) * across
    u, v = u * rows, v * rows * rng.choice([1.0, 2.0])
    u = u + 0.5 * (np.floor(v) % 2) * rng.integers(2)
    check = (np.floor(u) + np.floor(v)) % 2
    joint = np.minimum(np.abs(u % 1 - 0.5), np.abs(v % 1 - 0.5)) > 0.0
    joint &= np.maximum(np.abs(u % 1 - 0.5), np.abs(v % 1 - 0.5)) > 0.46
    one, other = _two_colours(rng)
    share = np.where(joint, 1.0, check * rng.integers(2))[..., None]
    return (one + (other - one) * share + 0.1 * (_noise(size, rng, 0.6)[..., None] - 0.5)).astype(np.float32)


def clutter(size: int, rng: Rng) -> Ground:
    """Boxes and discs of many colours, more or less out of focus."""
    ground = np.ascontiguousarray(clouds(size, rng))
    for _ in range(rng.integers(4, 25)):
        at, reach = rng.integers(0, size, 2), rng.integers(size // 20 + 1, size // 4 + 2, 2)
        colour = rng.uniform(0, 1, 3).tolist()
        if rng.random() < 0.5:
            cv2.ellipse(
                ground, at.tolist(), reach.tolist(), float(rng.uniform(0, 180)), 0, 360, colour, -1, cv2.LINE_AA
            )
        else:
            cv2.rectangle(ground, at.tolist(), (at + reach).tolist(), colour, -1)
    return _blurred(ground, rng.uniform(0, 0.03) * size)


def room(size: int, rng: Rng) -> Ground:
    """A wall above a floor, each with a surface of its own; sometimes a second wall or a skirting board."""
    surfaces = (studio, studio, clouds, planks, tiles)
    wall, floor = (surfaces[rng.integers(len(surfaces))](size, rng) for _ in range(2))
    horizon = rng.uniform(0.35, 0.85)
    near = cv2.getPerspectiveTransform(
        np.array([[0, 0], [size, 0], [size, size], [0, size]], np.float32),
        np.array([[0.1, horizon], [0.9, horizon], [1.9, 1.3], [-0.9, 1.3]], np.float32) * size,
    )
    floor = cv2.warpPerspective(floor, near, (size, size), borderMode=cv2.BORDER_REFLECT)
    across, down = _axes(size)
    line = down + 1 > 2 * horizon + rng.normal() * 0.03 * across
    ground = np.where(line[..., None], floor, wall * rng.uniform(0.7, 1.1)).astype(np.float32)
    if rng.random() < 0.3:
        board = line & (down + 1 < 2 * horizon + 0.08)
        ground = np.where(board[..., None], rng.uniform(0.1, 1), ground).astype(np.float32)
    if rng.random() < 0.3:
        ground = np.where((across > rng.uniform(-0.8, 0.8))[..., None] & ~line[..., None], ground * 0.85, ground)
    return _blurred(ground.astype(np.float32), rng.uniform(0, 0.012) * size)


def _placed(view: RGBA, size: int, rng: Rng) -> Float32[np.ndarray, "s s 4"]:
    """The view at a random size and place, mirrored or not, premultiplied and undone again, in [0, 1]."""
    ys, xs = np.nonzero(view[..., 3] > 32)
    box = view[ys.min() : ys.max() + 1, xs.min() : xs.max() + 1].astype(np.float32) / 255
    box = box[:, :: rng.choice([-1, 1])]
    box[..., :3] *= box[..., 3:]
    scale = rng.uniform(0.4, 0.95) * size / max(box.shape[:2])
    small = cv2.resize(box, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    free = np.array([size, size]) - small.shape[:2]
    middle = np.clip(rng.normal(0.5, 0.2, 2), 0, 1)
    top, left = np.maximum(free * middle, 0).astype(int)
    placed = np.zeros((size, size, 4), np.float32)
    placed[top : top + small.shape[0], left : left + small.shape[1]] = small
    placed[..., :3] /= np.maximum(placed[..., 3:], 1e-3)
    return placed


def _recoloured(colour: Ground, ground: Ground, coverage: Plane, rng: Rng) -> Ground:
    """The object pale, or coloured nearly as the ground beside it, or as it is."""
    kind = rng.random()
    if kind < 0.2:
        return colour + (1 - colour) * np.float32(rng.uniform(0.5, 0.9))
    if kind < 0.45:
        weight = coverage[..., None] / max(coverage.sum(), 1)
        own, beside = (colour * weight).sum((0, 1)), (ground * weight).sum((0, 1))
        return (colour + (beside - own) * rng.uniform(0.5, 0.95)).clip(0, 1).astype(np.float32)
    return (colour ** rng.uniform(0.6, 1.6)).astype(np.float32)


def _shaded(ground: Ground, coverage: Plane, rng: Rng) -> Ground:
    """The ground with the shadow that the object casts on it: thrown to one side, or a soft spot below."""
    size, strength = len(ground), rng.uniform(0.1, 0.6) * (rng.random() < 0.75)
    foot = np.nonzero(coverage.max(1) > 0.1)[0].max() + 1
    if rng.random() < 0.6:
        flat, shear = rng.uniform(0.1, 0.6), rng.uniform(-1.2, 1.2)
        matrix = np.array([[1, -shear, shear * foot], [0, flat, foot - flat * foot]], np.float32)
        cast = cv2.warpAffine(coverage, matrix, (size, size))
    else:
        across = np.nonzero(coverage.max(0) > 0.1)[0]
        cast = np.zeros((size, size), np.float32)
        reach = (max(1, int(np.ptp(across) * rng.uniform(0.3, 0.6))), max(1, int(size * rng.uniform(0.02, 0.1))))
        cv2.ellipse(cast, (int(across.mean()), int(foot - 0.02 * size)), reach, 0, 0, 360, (1.0,), -1)
    cast = _blurred(cast, rng.uniform(0.005, 0.06) * size)
    near = _blurred(cv2.dilate(coverage, np.ones((3, 3))), 0.02 * size) * rng.uniform(0, 0.3) * (rng.random() < 0.4)
    return ground * (1 - np.maximum(cast, near) * strength)[..., None].astype(np.float32)


def _glass(coverage: Plane, rng: Rng) -> Plane | float:
    """How opaque the object is: all of it, or in one of twelve pictures little but its outline."""
    if rng.random() > 1 / 12:
        return 1.0
    inside = np.asarray(cv2.erode(coverage, np.ones((5, 5))), np.float32)
    return (1 - inside * rng.uniform(0.4, 0.85)).astype(np.float32)


def _photographed(picture: Ground, rng: Rng) -> UInt8[np.ndarray, "s s 3"]:
    """Blur, grain, and the blocks of a JPEG."""
    picture = _blurred(picture, rng.uniform(0, 1.0))
    picture = picture + rng.normal(size=picture.shape[:2])[..., None] * rng.uniform(0, 0.03) * (rng.random() < 0.5)
    bytes_ = (picture.clip(0, 1) * 255).astype(np.uint8)
    if rng.random() < 0.5:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(40, 95))]
        bytes_ = np.asarray(cv2.imdecode(cv2.imencode(".jpg", bytes_, quality)[1], cv2.IMREAD_COLOR), np.uint8)
    return bytes_


def _lit(ground: Ground, rng: Rng) -> Ground:
    """The ground under a light that falls off to one side."""
    across, down = _axes(len(ground))
    turn = rng.uniform(0, 2 * np.pi)
    light = 1 + rng.uniform(0, 0.3) * (rng.random() < 0.5) * (np.cos(turn) * across + np.sin(turn) * down)
    return (ground * light[..., None]).clip(0, 1).astype(np.float32)


def _piece(photograph: Photograph, size: int, rng: Rng) -> Ground:
    """A square piece of a photograph, mirrored or not."""
    side = int(rng.uniform(0.4, 1) * min(photograph.shape[:2]))
    top, left = (int(rng.integers(0, free + 1)) for free in np.array(photograph.shape[:2]) - side)
    piece = photograph[top : top + side, left : left + side][:, :: rng.choice([-1, 1])]
    return cv2.resize(np.ascontiguousarray(piece), (size, size), interpolation=cv2.INTER_AREA)


def _noise(size: int, rng: Rng, roughness: float) -> Plane:
    """Noise in [0, 1] whose finer scales are weaker the lower the roughness is."""
    total = np.zeros((size, size), np.float32)
    for octave in range(2, int(np.log2(size)) + 1):
        coarse = rng.random((2**octave, 2**octave), np.float32)
        finer = np.asarray(cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC), np.float32)
        total += roughness**octave * finer
    low, high = total.min(), total.max()
    return (total - low) / max(high - low, 1e-6)


def _two_colours(rng: Rng) -> tuple[Float32[np.ndarray, "3"], Float32[np.ndarray, "3"]]:
    one = rng.uniform(0, 1, 3) if rng.random() < 0.5 else np.full(3, rng.uniform(0, 1))
    return one.astype(np.float32), (one + rng.normal(size=3) * rng.choice([0.08, 0.3])).clip(0, 1).astype(np.float32)


def _colours(shade: np.ndarray, base: np.ndarray) -> Ground:
    return (base + shade[..., None]).clip(0, 1).astype(np.float32)


def _axes(size: int) -> tuple[Float32[np.ndarray, "s s"], Float32[np.ndarray, "s s"]]:
    """Across and down, from -1 to 1."""
    line = ((np.arange(size) * 2 + 1) / size - 1).astype(np.float32)
    across, down = np.meshgrid(line, line)
    return across, down


def _blurred(picture: np.ndarray, sigma: float) -> np.ndarray:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma)) if sigma > 0.2 else picture
