"""What the parts of assets are made of: one table with the words of a part's name, Infinigen's materials, and a finish.

Infinigen's materials are for Blender and for baked maps; a finish is one colour and roughness, for previews and for
files without maps.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

# sRGB in [0, 1].
Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Finish:
    """A plain material: its name, a colour in sRGB, and roughness and metallic from 0 to 1."""

    name: str
    colour: Colour
    roughness: float = 0.7
    metallic: float = 0.0


@dataclass(frozen=True)
class Family:
    """A kind of material: its finish, and Infinigen's materials, of which one is drawn for all parts of the family.

    A material that is named more than once is drawn more often, with about Infinigen's own weights.
    """

    finish: Finish
    infinigen: tuple[str, ...]


# The family of each part's material: that of the first pattern which matches in "generator/part".
PARTS = (
    ("^chair/seat$", "upholstery"),
    ("^table/top$", "table top"),
    ("^(chair|table)/", "frame"),
    ("^vase/", "ceramic"),
    ("^basket/", "basket"),
    ("^flower/petal$", "petal"),
    ("^flower/centre$", "flower centre"),
    ("^dandelion/stem$", "green"),
    ("^dandelion/", "white"),
    # Parts of other generators, by words in their names.
    ("wood|plank|timber|oak", "wood"),
    ("metal|steel|iron|brass|chrome|copper", "metal"),
    ("fabric|cloth|shade|cushion|textile|seat|leather", "upholstery"),
    ("ceramic|porcelain|clay|pot|vase", "ceramic"),
    ("leaf|leaves|stem|grass|green", "green"),
    ("petal|flower", "petal"),
)
# The family of a part that no pattern matches.
NEUTRAL = "plastic"

_WOOD = Finish("wood", (0.56, 0.40, 0.26), 0.55)
FAMILIES = {
    "frame": Family(
        _WOOD,
        ("materials.wood:Wood", "materials.wood:Wood", "materials.wood:BlondePlywood", "materials.wood:BlackPlywood")
        + ("materials.metal:BrushedMetal", "materials.plastic:PlasticRough"),
    ),
    "upholstery": Family(
        Finish("fabric", (0.52, 0.55, 0.58), 0.9),
        ("materials.fabric:FineKnitFabric", "materials.fabric:CoarseKnitFabric", "materials.fabric:Leather")
        + ("materials.wood:Wood", "materials.plastic:PlasticRough"),
    ),
    "table top": Family(
        replace(_WOOD, colour=(0.64, 0.47, 0.31), roughness=0.4),
        ("materials.wood:Wood", "materials.wood:TableWood", "materials.ceramic:Marble")
        + ("materials.plastic:PlasticRough",),
    ),
    "wood": Family(_WOOD, ("materials.wood:Wood", "materials.wood:TableWood", "materials.wood:BlondePlywood")),
    "metal": Family(
        Finish("metal", (0.76, 0.76, 0.77), 0.35, 1.0),
        ("materials.metal:MetalBasic", "materials.metal:BrushedMetal", "materials.metal:GalvanizedMetal"),
    ),
    "ceramic": Family(
        Finish("ceramic", (0.85, 0.83, 0.78), 0.2),
        ("materials.ceramic:Ceramic", "materials.ceramic:VaseCeramic", "materials.ceramic:Marble"),
    ),
    "basket": Family(
        Finish("plastic", (0.74, 0.68, 0.57), 0.6),
        ("materials.plastic:PlasticRough", "materials.plastic:PlasticRough", "materials.wood:Wood"),
    ),
    "plastic": Family(Finish("plastic", (0.66, 0.68, 0.70), 0.5), ("materials.plastic:PlasticRough",)),
    "petal": Family(Finish("plant", (0.93, 0.66, 0.73), 0.6), ("objects.grassland.flower:shader_petal",)),
    "flower centre": Family(
        Finish("seeds", (0.80, 0.60, 0.20), 0.8), ("objects.grassland.flower:shader_flower_center",)
    ),
    "green": Family(
        Finish("plant", (0.43, 0.55, 0.27), 0.6), ("materials.plant.simple_greenery:shader_simple_greenery",)
    ),
    "white": Family(Finish("white", (0.92, 0.91, 0.86), 0.85), ("materials.plant.simple_whitish:shader_simple_white",)),
}
# Colours that tell parts apart, one after the other.
PALETTE = np.array(
    [
        [0.76, 0.60, 0.42],
        [0.45, 0.58, 0.66],
        [0.66, 0.45, 0.40],
        [0.55, 0.65, 0.45],
        [0.62, 0.55, 0.70],
        [0.80, 0.72, 0.50],
    ]
)


def family(generator: str, part: str) -> str:
    """The family of a part's material, from its name and the name or path of its generator."""
    name = f"{Path(generator).stem}/{part}".lower()
    return next((kind for pattern, kind in PARTS if re.search(pattern, name)), NEUTRAL)


def finishes(generator: str, part_names: tuple[str, ...]) -> tuple[Finish, ...]:
    """A plausible finish for each part, named after the part and what it is made of."""
    plain = [FAMILIES[family(generator, part)].finish for part in part_names]
    return tuple(replace(one, name=f"{part}_{one.name}") for one, part in zip(plain, part_names, strict=True))


def part_colours(part_names: tuple[str, ...]) -> dict[str, Colour]:
    """A colour for each part that tells it from the others."""
    return {part: as_colour(PALETTE[number % len(PALETTE)]) for number, part in enumerate(part_names)}


def coloured(generator: str, part_names: tuple[str, ...], known: Mapping[str, Colour]) -> tuple[Finish, ...]:
    """The finishes with the colours that are known, if any are; a part with one is no bare metal."""
    plain = finishes(generator, part_names)
    if not known:
        return plain
    colours = [_colour(generator, part, known) for part in part_names]
    return tuple(replace(one, colour=colour, metallic=0.0) for one, colour in zip(plain, colours, strict=True))


def _colour(generator: str, part: str, known: Mapping[str, Colour]) -> Colour:
    """The colour of a part that is known; else the mean of the parts of its family, or of all where it has none."""
    if part in known:
        return known[part]
    kin = [colour for other, colour in known.items() if family(generator, other) == family(generator, part)]
    return as_colour(srgb(linear(np.array(kin or list(known.values()))).mean(0)))


def check_colours(colours: object) -> dict[str, Colour]:
    """Colours of parts from a file; raises ValueError with a sentence for what is none."""
    if isinstance(colours, Mapping) and all(_is_colour(colour) for colour in colours.values()):
        return {str(part): as_colour(np.array(colour)) for part, colour in colours.items()}
    raise ValueError(f'Colours of parts are numbers from 0 to 1, as in {{"seat": [0.8, 0.1, 0.1]}}, got {colours}.')


def colours_in_hex(settings: Mapping[str, str]) -> dict[str, Colour]:
    """Colours of parts as a command has them, such as `seat=#b51f1a`; raises ValueError with a sentence."""
    for part, text in settings.items():
        if not re.fullmatch("#[0-9a-fA-F]{6}", text):
            raise ValueError(f"The colour of a part is written as in seat=#b51f1a, got {part}={text}.")
    return {part: as_colour(np.array(list(bytes.fromhex(text[1:]))) / 255) for part, text in settings.items()}


def in_bytes(colour: Colour) -> Colour:
    """The nearest colour that eight bits for each of its numbers can say, as `#b51f1a` does."""
    return as_colour(np.rint(255 * np.array(colour)) / 255)


def _is_colour(value: object) -> bool:
    numbers = value if isinstance(value, (list, tuple)) else ()
    return len(numbers) == 3 and all(isinstance(one, (int, float)) and 0 <= one <= 1 for one in numbers)


def as_colour(values: Float[np.ndarray, "3"]) -> Colour:
    """Three numbers as a colour."""
    red, green, blue = (float(value) for value in values)
    return red, green, blue


def linear(srgb: Float[np.ndarray, "*c"]) -> Float[np.ndarray, "*c"]:
    """Colours in [0, 1] from sRGB (IEC 61966-2-1) to linear light, in which materials are shaded."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def srgb(linear: Float[np.ndarray, "*c"]) -> Float[np.ndarray, "*c"]:
    """Linear light, clipped to [0, 1], as sRGB (IEC 61966-2-1)."""
    light = np.clip(linear, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
