"""Making one rendered picture look like many photographs and drawings; each change has its own switch.

The paper's (section 3.2): colour, flip, crop, mask as condition, edges as condition. Everything takes and returns an
RGBA picture, except `to_network`, which ends the chain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from dipcg.images import edges, over_white, silhouette

RGBA = UInt8[np.ndarray, "h w 4"]


@dataclass(frozen=True)
class AugmentConfig:
    """How often each change is made, from 0 (never) to 1 (always)."""

    mask: float = 0.08
    edges: float = 0.12
    colour: float = 0.8
    background: float = 0.25
    crop: float = 0.7
    blur: float = 0.25
    noise: float = 0.3
    flip: float = 0.5


def augment(image: RGBA, config: AugmentConfig, rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """One random version of a picture, over its background, without the flip (which changes the answer too)."""
    wanted = {name: rng.random() < share for name, share in vars(config).items()}
    image = shift(image, rng) if wanted["crop"] else image
    if wanted["edges"]:
        return over_white(edges(image))
    if wanted["mask"]:
        return over_white(silhouette(image))
    image = recolour(image, rng) if wanted["colour"] else image
    picture = over_background(image, rng) if wanted["background"] else over_white(image)
    picture = blur(picture, rng) if wanted["blur"] else picture
    return add_noise(picture, rng) if wanted["noise"] else picture


def shift(image: RGBA, rng: np.random.Generator, most: float = 0.06) -> RGBA:
    """Crop or pad by a few percent, as an imperfect cut-out would."""
    import cv2

    size = image.shape[0]
    scale = 1 + rng.uniform(-most, most)
    offset = (1 - scale) * size / 2 + rng.uniform(-most / 2, most / 2, 2) * size
    matrix = np.array([[scale, 0, offset[0]], [0, scale, offset[1]]])
    return cv2.warpAffine(image, matrix, (size, size), flags=cv2.INTER_LINEAR)


def recolour(image: RGBA, rng: np.random.Generator) -> RGBA:
    """Saturation, then by a table for each channel a gamma, a tint, contrast and brightness."""
    import cv2

    saturation = rng.uniform(0.0, 1.6)
    mixed = cv2.transform(image[..., :3], np.eye(3) * saturation + (1 - saturation) / 3)
    levels = np.linspace(0, 1, 256)[:, None] ** np.exp(rng.uniform(-0.5, 0.5)) * rng.uniform(0.85, 1.1, 3)
    levels = (levels - 0.5) * rng.uniform(0.7, 1.3) + 0.5 + rng.uniform(-0.08, 0.08)
    table = (levels * 255).clip(0, 255).astype(np.uint8)
    return np.dstack([cv2.LUT(mixed, table[None]), image[..., 3]])


def over_background(image: RGBA, rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """On a nearly white or coloured ground with a slope, sometimes with a shadow below."""
    size = image.shape[0]
    base = rng.uniform(225, 255) if rng.random() < 0.7 else rng.uniform(60, 255)
    ramp = np.linspace(-1, 1, size, dtype=np.float32)
    ground = base + rng.uniform(-15, 15) * ramp[:, None, None] + rng.uniform(-15, 15) * ramp[None, :, None]
    ground = ground + rng.uniform(-12, 12, 3).astype(np.float32) - _shadow(size, rng)
    alpha = image[..., 3:].astype(np.float32) / 255
    return (image[..., :3] * alpha + ground.clip(0, 255) * (1 - alpha)).astype(np.uint8)


def blur(picture: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """Out of focus, or enlarged from fewer pixels."""
    import cv2

    return cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 1.2))


def add_noise(picture: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """The grain of a sensor."""
    noise = rng.standard_normal(picture.shape[:2], dtype=np.float32)[..., None] * rng.uniform(1, 10)
    return (picture + noise).clip(0, 255).astype(np.uint8)


def _shadow(size: int, rng: np.random.Generator) -> np.ndarray:
    if rng.random() < 0.5:
        return np.zeros((size, size, 1), np.float32)
    rows, columns = np.mgrid[:size, :size].astype(np.float32) / size
    away = ((columns - rng.uniform(0.3, 0.7)) / 0.35) ** 2 + ((rows - rng.uniform(0.8, 0.95)) / 0.1) ** 2
    return (rng.uniform(10, 60) * np.exp(-away))[..., None]
