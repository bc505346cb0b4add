"""Making one rendered picture look like many photographs and drawings; each change has its own switch.

The paper's (section 3.2): colour, flip, crop, mask as condition, edges as condition. A picture is RGBA
until the background is behind it, and RGB from then on.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt8

from dipcg.config import AugmentConfig
from dipcg.images import edges, over_white, silhouette

RGBA = UInt8[np.ndarray, "h w 4"]


def augment(
    image: RGBA, config: AugmentConfig, rng: np.random.Generator, drawing: bool = False
) -> UInt8[np.ndarray, "h w 3"]:
    """One random version of a picture, over its background, without view and flip (which change the answer too).

    Of a `drawing` the picture shows the surface's normals, and only its lines are drawn.
    """
    wanted = {name: rng.random() < share for name, share in vars(config).items()}
    image = shift(image, rng) if wanted["crop"] else image
    image = hide(image, rng) if wanted["hide"] else image
    if drawing:
        return draw_lines(image, rng)
    if wanted["edges"]:
        return over_white(edges(image))
    if wanted["mask"]:
        return over_white(silhouette(image))
    image = recolour(image, rng) if wanted["colour"] else image
    picture = over_background(image, rng) if wanted["background"] else over_white(image)
    picture = blur(picture, rng) if wanted["blur"] else picture
    picture = add_noise(picture, rng) if wanted["noise"] else picture
    return compress(picture, rng) if wanted["jpeg"] else picture


def draw_lines(normals: RGBA, rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """Lines where the surface folds or ends, of random darkness and width, bent a little as a hand would."""
    import cv2

    lines = 255 - edges(normals)[..., 0]
    bent = cv2.remap(lines, *_bend(len(lines), rng), cv2.INTER_LINEAR)
    wide = cv2.GaussianBlur(bent, (0, 0), rng.uniform(0.3, 0.9)).astype(np.float32) * rng.uniform(1.0, 3.0)
    ink = rng.uniform(0.5, 1.0) * wide.clip(0, 255)
    return np.repeat((255 - ink).astype(np.uint8)[..., None], 3, 2)


def hide(image: RGBA, rng: np.random.Generator) -> RGBA:
    """A box in front of a tenth of the picture or less: cut out with the object, or painted over it."""
    size = len(image)
    extent = (rng.uniform(0.1, 0.35, 2) * size).astype(int)
    top, left = (rng.uniform(0, 1, 2) * (size - extent)).astype(int)
    box = (slice(top, top + extent[0]), slice(left, left + extent[1]))
    image = image.copy()
    if rng.random() < 0.5:
        image[box][..., 3] = 0
    else:
        image[(*box, slice(3))] = rng.integers(0, 256, 3)
    return image


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


def compress(picture: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """Written and read as JPEG."""
    import cv2

    _, written = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 90))])
    return np.asarray(cv2.imdecode(written, cv2.IMREAD_COLOR), np.uint8)


def _bend(size: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """For each pixel the column and the row it is taken from: off by about a pixel, smoothly."""
    import cv2

    coarse = rng.normal(0, rng.uniform(0, 0.01) * size, (2, 5, 5)).astype(np.float32)
    rows, columns = np.mgrid[:size, :size].astype(np.float32)
    across, down = (cv2.resize(part, (size, size), interpolation=cv2.INTER_CUBIC) for part in coarse)
    return columns + across, rows + down


def _shadow(size: int, rng: np.random.Generator) -> np.ndarray:
    if rng.random() < 0.5:
        return np.zeros((size, size, 1), np.float32)
    rows, columns = np.mgrid[:size, :size].astype(np.float32) / size
    away = ((columns - rng.uniform(0.3, 0.7)) / 0.35) ** 2 + ((rows - rng.uniform(0.8, 0.95)) / 0.1) ** 2
    return (rng.uniform(10, 60) * np.exp(-away))[..., None]
