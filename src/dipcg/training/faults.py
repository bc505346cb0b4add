"""What goes wrong when an object is cut out of a photograph: pieces are lost, and pieces of the ground stay.

Each takes views, and the last ones return pictures on white with what was left of the ground.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Generator, Tensor

from dipcg.training.draws import Pictures, Plane, Views, between, blobs, coordinates, gaussian, over


def hide(views: Views, rng: Generator) -> Views:
    """A box in front of a tenth of the picture or less: cut out with the object, or painted over it."""
    across, down = coordinates(views)
    half = [between(views, 0.1, 0.35, rng) for _ in range(2)]
    centre = [between(views, -1, 1, rng) * (1 - part) for part in half]
    inside = ((across - centre[0]).abs() < half[0]) & ((down - centre[1]).abs() < half[1])
    painted = between(views, 0, 1, rng) < 0.5
    colour = torch.cat([between(views, 0, 1, rng) for _ in range(3)], 1)
    alpha = torch.where(inside & ~painted, 0.0, views[:, 3:4])
    return torch.cat([torch.where(inside & painted, colour, views[:, :3]), alpha], 1)


def eat(views: Views, rng: Generator) -> Views:
    """Pieces of the object missing, in blobs, as a cut-out by colour leaves it where object and ground are alike."""
    keep = (blobs(views, 7, rng) < between(views, 0.72, 0.95, rng)).to(views.dtype)
    return torch.cat([views[:, :3], views[:, 3:] * keep], 1)


def lose(views: Views, rng: Generator) -> Views:
    """All missing that has nearly one of the object's own colours, as where object and ground have the same one."""
    rows, size = torch.arange(len(views), device=views.device), views.shape[-1]
    weights = views[:, 3].flatten(1).double() + 1e-9
    chosen = torch.multinomial(weights, 1, generator=rng)[:, 0]
    colour = views[rows, :3, chosen // size, chosen % size][:, :, None, None]
    near = (views[:, :3] - colour).abs().amax(1, keepdim=True) < between(views, 0.02, 0.12, rng)
    # A colour that nearly all of the object has would leave nothing.
    share = (near * views[:, 3:]).sum((1, 2, 3), keepdim=True) / views[:, 3:].sum((1, 2, 3), keepdim=True).clamp_min(1)
    kept = torch.where(near & (share < 0.6), 0.0, views[:, 3:])
    return torch.cat([views[:, :3], kept], 1)


def hollow(views: Views, rng: Generator) -> Views:
    """Little left but the outline, as of glass."""
    inside = -F.max_pool2d(-views[:, 3:], 5, 1, 2)
    return torch.cat([views[:, :3], views[:, 3:] - inside * between(views, 0.5, 1, rng)], 1)


def over_background(views: Views, rng: Generator) -> Pictures:
    """On a nearly white or coloured ground with a slope, half of them with a soft shadow."""
    return over(views, _ground(views, rng) - _soft_shadow(views, rng))


def over_shadow(views: Views, rng: Generator) -> Pictures:
    """On white with the shadow that a cut-out leaves: a soft spot below the object, or its outline on the floor."""
    hard = between(views, 0, 1, rng) < 0.4
    dark = _cast_shadow(views, rng) * between(views, 0.1, 0.5, rng)
    return over(views, 1 - torch.where(hard, dark, 2 * _soft_shadow(views, rng)))


def over_floor(views: Views, rng: Generator) -> Pictures:
    """On white with a piece of the floor left in: all below a line, or a blob around the foot of the object."""
    _, down = coordinates(views)
    line = down > between(views, 0.5, 0.95, rng) + between(views, -0.2, 0.2, rng) * coordinates(views)[0]
    blob = (blobs(views, 4, rng) > 0.5) & (down > between(views, 0.1, 0.8, rng))
    left = torch.where(between(views, 0, 1, rng) < 0.5, line, blob).to(views.dtype)
    return over(views, torch.lerp(torch.ones_like(views[:, :3]), _ground(views, rng), left))


def over_halo(views: Views, rng: Generator) -> Pictures:
    """On white with a rim of the ground's colour around the object, a pixel or two wide."""
    rim = F.max_pool2d(views[:, 3:4], 3, 1, 1)
    wide = F.max_pool2d(rim, 3, 1, 1)
    rim = torch.where(between(views, 0, 1, rng) < 0.5, rim, wide)
    return over(views, torch.lerp(torch.ones_like(views[:, :3]), _ground(views, rng), rim))


def over_pieces(views: Views, rng: Generator) -> Pictures:
    """On white with pieces of a ground of two colours: shards anywhere, a fringe around the object, or all of it."""
    pattern = (_pattern(views, rng) > 0.5).to(views.dtype)
    ground = torch.lerp(_colour(views, rng), _colour(views, rng), gaussian(pattern, 0.3, 1.5, rng))
    near = gaussian(F.max_pool2d(views[:, 3:4], 9, 1, 4), 1.0, 4.0, rng)
    kind = between(views, 0, 1, rng)
    shards = blobs(views, 6, rng) > between(views, 0.55, 0.8, rng)
    fringe = blobs(views, 12, rng) * near > between(views, 0.2, 0.6, rng)
    left = torch.where(kind < 0.4, shards, torch.where(kind < 0.8, fringe, True)).to(views.dtype)
    return over(views, torch.lerp(torch.ones_like(views[:, :3]), ground, left))


def over_things(views: Views, rng: Generator) -> Pictures:
    """On white with a part of another thing behind or beside the object: the next view of the batch, moved."""
    other = views.roll(1, 0)
    scale, side = between(views, 0.8, 2.0, rng), between(views, 0.3, 1.0, rng) * between(views, -1, 1, rng).sign()
    matrix = torch.zeros(len(views), 2, 3, device=views.device, dtype=views.dtype)
    matrix[:, 0, 0] = matrix[:, 1, 1] = scale.flatten()
    matrix[:, 0, 2] = (-side * scale).flatten()
    grid = F.affine_grid(matrix, [len(views), 4, *views.shape[-2:]], align_corners=False)
    moved = F.grid_sample(other, grid, align_corners=False)
    colour = torch.lerp(moved[:, :3], _colour(views, rng).expand_as(moved[:, :3]), 0.5)
    return over(views, torch.lerp(torch.ones_like(colour), colour, moved[:, 3:]))


def _pattern(views: Views, rng: Generator) -> Plane:
    """Values around 0.5: stripes in any direction, or blobs of any size."""
    across, down = coordinates(views)
    turn, rate = between(views, 0, 3.14, rng), between(views, 6, 40, rng)
    stripes = 0.5 + 0.5 * ((across * turn.cos() + down * turn.sin()) * rate).sin()
    return torch.where(between(views, 0, 1, rng) < 0.5, stripes, blobs(views, 9, rng))


def _colour(views: Views, rng: Generator) -> Float[Tensor, "b 3 1 1"]:
    return torch.cat([between(views, 0, 1, rng) for _ in range(3)], 1)


def _ground(views: Views, rng: Generator) -> Pictures:
    """A nearly white ground, or one of any brightness, with a slope and a tint."""
    across, down = coordinates(views)
    light = between(views, 0.88, 1.0, rng)
    base = torch.where(between(views, 0, 1, rng) < 0.7, light, between(views, 0.2, 1.0, rng))
    slope = between(views, -0.06, 0.06, rng) * across + between(views, -0.06, 0.06, rng) * down
    tint = torch.cat([between(views, -0.05, 0.05, rng) for _ in range(3)], 1)
    return base + slope + tint


def _soft_shadow(views: Views, rng: Generator) -> Plane:
    """The darkness of a soft spot at the foot of the picture, none in half of the rows."""
    across, down = coordinates(views)
    wide, flat = between(views, 0.4, 0.9, rng), between(views, 0.1, 0.3, rng)
    away = ((across - between(views, -0.4, 0.4, rng)) / wide) ** 2 + (
        (down - between(views, 0.6, 0.9, rng)) / flat
    ) ** 2
    strength = between(views, 0.04, 0.24, rng) * (between(views, 0, 1, rng) < 0.5)
    return strength * (-away).exp()


def _cast_shadow(views: Views, rng: Generator) -> Plane:
    """The outline of the object thrown on a floor: flattened and sheared about its foot."""
    rows = torch.arange(views.shape[-1], device=views.device)
    lowest = ((views[:, 3] > 0.1).any(2) * rows).amax(1)
    foot = ((lowest + 1) * 2 / len(rows) - 1)[:, None]
    flat, shear = (between(views, *ends, rng)[:, :, 0, 0] for ends in ((1.5, 4.0), (-2.5, 2.5)))
    zero, one = torch.zeros_like(foot), torch.ones_like(foot)
    matrix = torch.stack([torch.cat([one, shear, -shear * foot], 1), torch.cat([zero, flat, foot - flat * foot], 1)], 1)
    grid = F.affine_grid(matrix, [len(views), 1, *views.shape[-2:]], align_corners=False)
    return gaussian(F.grid_sample(views[:, 3:4], grid, align_corners=False), 0.5, 2.5, rng)
