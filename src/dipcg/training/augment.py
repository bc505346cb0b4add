"""Random changes that make rendered views look like photographs, drawings and bad cut-outs, on whole batches.

The paper's changes (section 3.2) are colour, flip, crop, a mask as condition and edges as condition. The others repeat
what goes wrong when the object of a photograph is cut out: shadows and pieces of the ground stay, pieces of the object
are missing, a rim of the ground surrounds it.

A view has four channels in [0, 1]: red, green, blue, and coverage (straight alpha). Where a view shows the surface's
normals as colours, it becomes a line drawing. A picture has three channels, over its ground. Every change takes a batch
and a random generator, and changes each of its rows in its own way.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Generator, Tensor

from dipcg.config import AugmentConfig
from dipcg.training.jpeg import compress

Views = Float[Tensor, "b 4 s s"]
Pictures = Float[Tensor, "b 3 s s"]
Plane = Float[Tensor, "b 1 s s"]

# The largest change of scale and position of "crop", as a share of the side.
SHIFT = 0.06
# A silhouette is drawn in this grey, as `images.silhouette` does.
MASK_GREY = 60 / 255
# Canny's thresholds on Sobel gradients of values in [0, 1], as `images.edges` has them for values up to 255.
CANNY_LOW, CANNY_HIGH = 60 / 255, 140 / 255


def augment(
    views: Views, normals: Bool[Tensor, " b"], config: AugmentConfig, size: int, rng: Generator
) -> Float[Tensor, "b 3 {size} {size}"]:
    """One random version of each view as a picture of `size` pixels a side; views of `normals` become line drawings.

    Flips and cameras are drawn elsewhere, because they change the parameters and the camera that a picture shows.
    """
    views = resample(views, size, _drawn(views, config.crop, rng), rng)
    views = _some(hide, views, config.hide, rng)
    views = torch.where(normals[:, None, None, None], views, _some(eat, views, config.eaten, rng))
    drawn = torch.rand(len(views), generator=rng, device=views.device)
    ends = torch.tensor([config.mask, config.mask + config.edges], device=views.device)
    kinds = torch.where(normals, 3, torch.bucketize(drawn, ends, right=True))
    pictures = over_white(views)
    for number, change in enumerate((silhouette, edges, photograph(config), draw_lines)):
        rows = (kinds == number).nonzero().flatten()
        if len(rows):
            pictures[rows] = change(views[rows], rng)
    return pictures.clamp(0, 1)


def photograph(config: AugmentConfig) -> Callable[[Views, Generator], Pictures]:
    """The changes of a picture that is neither a drawing nor a mask."""

    def change(views: Views, rng: Generator) -> Pictures:
        views = _some(recolour, views, config.colour, rng)
        views = _some(bleach, views, config.pale, rng)
        pictures = over_white(views)
        for ground, share in (
            (over_background, config.background),
            (over_shadow, config.shadow),
            (over_floor, config.floor),
            (over_halo, config.halo),
        ):
            rows = _drawn(views, share, rng).nonzero().flatten()
            if len(rows):
                pictures[rows] = ground(views[rows], rng)
        pictures = _some(blur, pictures, config.blur, rng)
        pictures = _some(add_noise, pictures, config.noise, rng)
        return _some(compress, pictures, config.jpeg, rng)

    return change


def over_white(views: Views) -> Pictures:
    """The view on a white ground."""
    return _over(views, torch.ones_like(views[:, :1]))


def flip(views: Views, rows: Bool[Tensor, " b"]) -> Views:
    """The chosen rows mirrored left to right."""
    return torch.where(rows[:, None, None, None], views.flip(-1), views)


def resample(views: Views, size: int, rows: Bool[Tensor, " b"], rng: Generator) -> Float[Tensor, "b 4 {size} {size}"]:
    """The views at another size, the chosen rows shifted and scaled by a few percent as an imperfect crop would."""
    if views.shape[-1] == size and not rows.any():
        return views
    scale = 1 + SHIFT * _between(views, -1, 1, rng) * rows[:, None, None, None]
    offset = SHIFT * torch.cat([_between(views, -1, 1, rng) for _ in range(2)], 1) * rows[:, None, None, None]
    matrix = torch.cat([torch.diag_embed(scale.flatten(1).expand(-1, 2)), offset.flatten(1)[..., None]], 2)
    grid = F.affine_grid(matrix, [len(views), 4, size, size], align_corners=False)
    moved = F.grid_sample(_premultiplied(views), grid, align_corners=False)
    return torch.cat([moved[:, :3] / moved[:, 3:4].clamp_min(1e-3), moved[:, 3:]], 1).clamp(0, 1)


def hide(views: Views, rng: Generator) -> Views:
    """A box in front of a tenth of the picture or less: cut out with the object, or painted over it."""
    across, down = _coordinates(views)
    half = [_between(views, 0.1, 0.35, rng) for _ in range(2)]
    centre = [_between(views, -1, 1, rng) * (1 - part) for part in half]
    inside = ((across - centre[0]).abs() < half[0]) & ((down - centre[1]).abs() < half[1])
    painted = _between(views, 0, 1, rng) < 0.5
    colour = torch.cat([_between(views, 0, 1, rng) for _ in range(3)], 1)
    alpha = torch.where(inside & ~painted, 0.0, views[:, 3:4])
    return torch.cat([torch.where(inside & painted, colour, views[:, :3]), alpha], 1)


def eat(views: Views, rng: Generator) -> Views:
    """Pieces of the object missing, in blobs, as a cut-out by colour leaves it where object and ground are alike."""
    keep = (_blobs(views, 7, rng) < _between(views, 0.72, 0.95, rng)).to(views.dtype)
    return torch.cat([views[:, :3], views[:, 3:] * keep], 1)


def draw_lines(views: Views, rng: Generator) -> Pictures:
    """Lines where the surface folds or ends, of random darkness and width, bent a little as a hand would."""
    bend = torch.randn(len(views), 2, 5, 5, generator=rng, device=views.device) * _between(views, 0, 0.02, rng)
    bend = F.interpolate(bend, views.shape[-2:], mode="bicubic", align_corners=True).permute(0, 2, 3, 1)
    grid = torch.stack(torch.broadcast_tensors(*(part[:, 0] for part in _coordinates(views))), -1)
    lines = F.grid_sample(1 - edges(views, rng)[:, :1], grid + bend, align_corners=False)
    ink = (_gaussian(lines, 0.3, 0.9, rng) * _between(views, 1, 3, rng)).clamp(0, 1) * _between(views, 0.5, 1, rng)
    return (1 - ink).expand(-1, 3, -1, -1)


def silhouette(views: Views, rng: Generator) -> Pictures:
    """The object in plain dark grey on white: the paper's mask condition."""
    grey = torch.full_like(views[:, :3], MASK_GREY)
    return over_white(torch.cat([grey, views[:, 3:]], 1))


def edges(views: Views, rng: Generator) -> Pictures:
    """Dark Canny edges (Canny 1986) on white: the paper's sketch condition."""
    weights = views.new_tensor([0.299, 0.587, 0.114])[None, :, None, None]
    grey = (over_white(views) * weights).sum(1, keepdim=True)
    return (1 - torch.maximum(_canny(grey), _canny(views[:, 3:4]))).expand(-1, 3, -1, -1)


def recolour(views: Views, rng: Generator) -> Views:
    """Other saturation, gamma, tint, contrast and brightness."""
    colour = views[:, :3]
    colour = torch.lerp(colour.mean(1, keepdim=True), colour, _between(views, 0, 1.6, rng)).clamp(0, 1)
    tint = torch.cat([_between(views, 0.85, 1.1, rng) for _ in range(3)], 1)
    colour = colour.clamp_min(1e-4) ** _between(views, -0.5, 0.5, rng).exp() * tint
    colour = (colour - 0.5) * _between(views, 0.7, 1.3, rng) + 0.5 + _between(views, -0.08, 0.08, rng)
    return torch.cat([colour.clamp(0, 1), views[:, 3:]], 1)


def bleach(views: Views, rng: Generator) -> Views:
    """A pale object, hardly darker than a white ground."""
    colour = torch.lerp(views[:, :3], torch.ones_like(views[:, :3]), _between(views, 0.4, 0.85, rng))
    return torch.cat([colour, views[:, 3:]], 1)


def over_background(views: Views, rng: Generator) -> Pictures:
    """On a nearly white or coloured ground with a slope, half of them with a soft shadow."""
    return _over(views, _ground(views, rng) - _soft_shadow(views, rng))


def over_shadow(views: Views, rng: Generator) -> Pictures:
    """On white with the shadow that a cut-out leaves: a soft spot below the object, or its outline on the floor."""
    hard = _between(views, 0, 1, rng) < 0.4
    dark = _cast_shadow(views, rng) * _between(views, 0.1, 0.5, rng)
    return _over(views, 1 - torch.where(hard, dark, 2 * _soft_shadow(views, rng)))


def over_floor(views: Views, rng: Generator) -> Pictures:
    """On white with a piece of the floor left in: all below a line, or a blob around the foot of the object."""
    _, down = _coordinates(views)
    line = down > _between(views, 0.5, 0.95, rng) + _between(views, -0.2, 0.2, rng) * _coordinates(views)[0]
    blob = (_blobs(views, 4, rng) > 0.5) & (down > _between(views, 0.1, 0.8, rng))
    left = torch.where(_between(views, 0, 1, rng) < 0.5, line, blob).to(views.dtype)
    return _over(views, torch.lerp(torch.ones_like(views[:, :3]), _ground(views, rng), left))


def over_halo(views: Views, rng: Generator) -> Pictures:
    """On white with a rim of the ground's colour around the object, a pixel or two wide."""
    rim = F.max_pool2d(views[:, 3:4], 3, 1, 1)
    wide = F.max_pool2d(rim, 3, 1, 1)
    rim = torch.where(_between(views, 0, 1, rng) < 0.5, rim, wide)
    return _over(views, torch.lerp(torch.ones_like(views[:, :3]), _ground(views, rng), rim))


def blur(pictures: Pictures, rng: Generator) -> Pictures:
    """Out of focus, or enlarged from fewer pixels."""
    return _gaussian(pictures, 0.4, 1.2, rng)


def add_noise(pictures: Pictures, rng: Generator) -> Pictures:
    """The grain of a sensor."""
    noise = torch.randn(pictures[:, :1].shape, generator=rng, device=pictures.device)
    return (pictures + noise * _between(pictures, 1 / 255, 10 / 255, rng)).clamp(0, 1)


def _some(change: Callable[[Tensor, Generator], Tensor], batch: Tensor, share: float, rng: Generator) -> Tensor:
    """The batch with a change made to a random share of its rows."""
    rows = _drawn(batch, share, rng).nonzero().flatten()
    return batch.index_copy(0, rows, change(batch[rows], rng)) if len(rows) else batch


def _drawn(batch: Tensor, share: float, rng: Generator) -> Bool[Tensor, " b"]:
    return torch.rand(len(batch), generator=rng, device=batch.device) < share


def _between(batch: Tensor, low: float | int, high: float | int, rng: Generator) -> Float[Tensor, "b 1 1 1"]:
    """A uniform number for each row."""
    return torch.rand(len(batch), 1, 1, 1, generator=rng, device=batch.device) * (high - low) + low


def _coordinates(batch: Tensor) -> tuple[Float[Tensor, "1 1 1 s"], Float[Tensor, "1 1 s 1"]]:
    """Across and down at the centres of pixels, from -1 to 1."""
    size = batch.shape[-1]
    line = (torch.arange(size, device=batch.device, dtype=batch.dtype) * 2 + 1) / size - 1
    return line[None, None, None], line[None, None, :, None]


def _premultiplied(views: Views) -> Views:
    return torch.cat([views[:, :3] * views[:, 3:4], views[:, 3:]], 1)


def _over(views: Views, ground: Float[Tensor, "b c s s"]) -> Pictures:
    """The view over a ground."""
    return torch.lerp(ground.clamp(0, 1).expand_as(views[:, :3]), views[:, :3], views[:, 3:4])


def _ground(views: Views, rng: Generator) -> Pictures:
    """A nearly white ground, or one of any brightness, with a slope and a tint."""
    across, down = _coordinates(views)
    light = _between(views, 0.88, 1.0, rng)
    base = torch.where(_between(views, 0, 1, rng) < 0.7, light, _between(views, 0.2, 1.0, rng))
    slope = _between(views, -0.06, 0.06, rng) * across + _between(views, -0.06, 0.06, rng) * down
    tint = torch.cat([_between(views, -0.05, 0.05, rng) for _ in range(3)], 1)
    return base + slope + tint


def _soft_shadow(views: Views, rng: Generator) -> Plane:
    """The darkness of a soft spot at the foot of the picture, none in half of the rows."""
    across, down = _coordinates(views)
    wide, flat = _between(views, 0.4, 0.9, rng), _between(views, 0.1, 0.3, rng)
    away = ((across - _between(views, -0.4, 0.4, rng)) / wide) ** 2 + (
        (down - _between(views, 0.6, 0.9, rng)) / flat
    ) ** 2
    strength = _between(views, 0.04, 0.24, rng) * (_between(views, 0, 1, rng) < 0.5)
    return strength * (-away).exp()


def _cast_shadow(views: Views, rng: Generator) -> Plane:
    """The outline of the object thrown on a floor: flattened and sheared about its foot."""
    rows = torch.arange(views.shape[-1], device=views.device)
    lowest = ((views[:, 3] > 0.1).any(2) * rows).amax(1)
    foot = ((lowest + 1) * 2 / len(rows) - 1)[:, None]
    flat, shear = (_between(views, *ends, rng)[:, :, 0, 0] for ends in ((1.5, 4.0), (-2.5, 2.5)))
    zero, one = torch.zeros_like(foot), torch.ones_like(foot)
    matrix = torch.stack([torch.cat([one, shear, -shear * foot], 1), torch.cat([zero, flat, foot - flat * foot], 1)], 1)
    grid = F.affine_grid(matrix, [len(views), 1, *views.shape[-2:]], align_corners=False)
    return _gaussian(F.grid_sample(views[:, 3:4], grid, align_corners=False), 0.5, 2.5, rng)


def _blobs(views: Views, cells: int, rng: Generator) -> Plane:
    """Smooth noise in [0, 1] with about `cells` bumps along a side."""
    coarse = torch.rand(len(views), 1, cells, cells, generator=rng, device=views.device)
    return F.interpolate(coarse, views.shape[-2:], mode="bicubic", align_corners=False)


def _gaussian(batch: Float[Tensor, "b c s s"], low: float, high: float, rng: Generator) -> Float[Tensor, "b c s s"]:
    """Blurred by a Gaussian whose width in pixels is drawn for each row."""
    reach = math.ceil(2.5 * high)
    distance = torch.arange(-reach, reach + 1, device=batch.device, dtype=batch.dtype)
    kernel = (-0.5 * (distance / _between(batch, low, high, rng)[:, :, 0]) ** 2).exp()
    kernel = (kernel / kernel.sum(-1, keepdim=True)).expand(-1, batch.shape[1], -1).flatten(0, 1)
    flat = F.pad(batch, [reach] * 4, mode="replicate").flatten(0, 1)[None]
    across = F.conv2d(flat, kernel[:, None, None], groups=len(kernel))
    return F.conv2d(across, kernel[:, None, :, None], groups=len(kernel))[0].unflatten(0, batch.shape[:2])


def _canny(grey: Plane) -> Plane:
    """1 on edges: Sobel gradients, thinned along their direction, weak ones kept beside strong ones."""
    sobel = grey.new_tensor([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]])
    slope = F.conv2d(F.pad(grey, [1] * 4, mode="replicate"), torch.stack([sobel, sobel.T])[:, None])
    strength = slope.abs().sum(1, keepdim=True)
    padded = F.pad(strength, [1] * 4)
    sector = (torch.atan2(slope[:, 1:], slope[:, :1]) / (math.pi / 4)).round().remainder(4)
    size = grey.shape[-1]
    highest = torch.zeros_like(strength, dtype=torch.bool)
    for number, (right, below) in enumerate(((1, 0), (1, 1), (0, 1), (-1, 1))):
        ahead = padded[..., 1 + below : 1 + below + size, 1 + right : 1 + right + size]
        behind = padded[..., 1 - below : 1 - below + size, 1 - right : 1 - right + size]
        highest |= (sector == number) & (strength > behind) & (strength >= ahead)
    strong = (highest & (strength > CANNY_HIGH)).to(grey.dtype)
    for _ in range(2):
        strong = torch.where(highest & (strength > CANNY_LOW), F.max_pool2d(strong, 3, 1, 1), strong)
    return strong
