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
from dipcg.training import faults
from dipcg.training.draws import Pictures, Plane, Views, between, coordinates, drawn, gaussian, over, some
from dipcg.training.jpeg import compress

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
    views = resample(views, size, drawn(views, config.crop, rng), rng)
    views = some(faults.hide, views, config.hide, rng)
    lost = views
    for fault, share in ((faults.eat, config.eaten), (faults.lose, config.lost), (faults.hollow, config.hollow)):
        lost = some(fault, lost, share, rng)
    views = torch.where(normals[:, None, None, None], views, lost)
    choice = torch.rand(len(views), generator=rng, device=views.device)
    ends = torch.tensor([config.mask, config.mask + config.edges], device=views.device)
    kinds = torch.where(normals, 3, torch.bucketize(choice, ends, right=True))
    pictures = over_white(views)
    for number, change in enumerate((silhouette, edges, photograph(config), draw_lines)):
        rows = (kinds == number).nonzero().flatten()
        if len(rows):
            pictures[rows] = change(views[rows], rng)
    return pictures.clamp(0, 1)


def photograph(config: AugmentConfig) -> Callable[[Views, Generator], Pictures]:
    """The changes of a picture that is neither a drawing nor a mask."""

    def change(views: Views, rng: Generator) -> Pictures:
        views = some(recolour, views, config.colour, rng)
        views = some(bleach, views, config.pale, rng)
        pictures = over_white(views)
        for ground, share in (
            (faults.over_background, config.background),
            (faults.over_shadow, config.shadow),
            (faults.over_floor, config.floor),
            (faults.over_halo, config.halo),
            (faults.over_pieces, config.pieces),
            (faults.over_things, config.beside),
        ):
            rows = drawn(views, share, rng).nonzero().flatten()
            if len(rows):
                pictures[rows] = ground(views[rows], rng)
        pictures = some(blur, pictures, config.blur, rng)
        pictures = some(add_noise, pictures, config.noise, rng)
        return some(compress, pictures, config.jpeg, rng)

    return change


def over_white(views: Views) -> Pictures:
    """The view on a white ground."""
    return over(views, torch.ones_like(views[:, :1]))


def flip(views: Views, rows: Bool[Tensor, " b"]) -> Views:
    """The chosen rows mirrored left to right."""
    return torch.where(rows[:, None, None, None], views.flip(-1), views)


def resample(views: Views, size: int, rows: Bool[Tensor, " b"], rng: Generator) -> Float[Tensor, "b 4 {size} {size}"]:
    """The views at another size, the chosen rows shifted and scaled by a few percent as an imperfect crop would."""
    if views.shape[-1] == size and not rows.any():
        return views
    scale = 1 + SHIFT * between(views, -1, 1, rng) * rows[:, None, None, None]
    offset = SHIFT * torch.cat([between(views, -1, 1, rng) for _ in range(2)], 1) * rows[:, None, None, None]
    matrix = torch.cat([torch.diag_embed(scale.flatten(1).expand(-1, 2)), offset.flatten(1)[..., None]], 2)
    grid = F.affine_grid(matrix, [len(views), 4, size, size], align_corners=False)
    moved = F.grid_sample(_premultiplied(views), grid, align_corners=False)
    return torch.cat([moved[:, :3] / moved[:, 3:4].clamp_min(1e-3), moved[:, 3:]], 1).clamp(0, 1)


def draw_lines(views: Views, rng: Generator) -> Pictures:
    """Lines where the surface folds or ends, of random darkness and width, bent a little as a hand would."""
    bend = torch.randn(len(views), 2, 5, 5, generator=rng, device=views.device) * between(views, 0, 0.02, rng)
    bend = F.interpolate(bend, views.shape[-2:], mode="bicubic", align_corners=True).permute(0, 2, 3, 1)
    grid = torch.stack(torch.broadcast_tensors(*(part[:, 0] for part in coordinates(views))), -1)
    lines = F.grid_sample(1 - edges(views, rng)[:, :1], grid + bend, align_corners=False)
    ink = (gaussian(lines, 0.3, 0.9, rng) * between(views, 1, 3, rng)).clamp(0, 1) * between(views, 0.5, 1, rng)
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
    colour = torch.lerp(colour.mean(1, keepdim=True), colour, between(views, 0, 1.6, rng)).clamp(0, 1)
    tint = torch.cat([between(views, 0.85, 1.1, rng) for _ in range(3)], 1)
    colour = colour.clamp_min(1e-4) ** between(views, -0.5, 0.5, rng).exp() * tint
    colour = (colour - 0.5) * between(views, 0.7, 1.3, rng) + 0.5 + between(views, -0.08, 0.08, rng)
    return torch.cat([colour.clamp(0, 1), views[:, 3:]], 1)


def bleach(views: Views, rng: Generator) -> Views:
    """A pale object, hardly darker than a white ground."""
    colour = torch.lerp(views[:, :3], torch.ones_like(views[:, :3]), between(views, 0.4, 0.85, rng))
    return torch.cat([colour, views[:, 3:]], 1)


def blur(pictures: Pictures, rng: Generator) -> Pictures:
    """Out of focus, or enlarged from fewer pixels."""
    return gaussian(pictures, 0.4, 1.2, rng)


def add_noise(pictures: Pictures, rng: Generator) -> Pictures:
    """The grain of a sensor."""
    noise = torch.randn(pictures[:, :1].shape, generator=rng, device=pictures.device)
    return (pictures + noise * between(pictures, 1 / 255, 10 / 255, rng)).clamp(0, 1)


def _premultiplied(views: Views) -> Views:
    return torch.cat([views[:, :3] * views[:, 3:4], views[:, 3:]], 1)


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
