"""Infinigen's procedural materials for the parts of our meshes; runs in a worker process, where Blender is."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from dipcg.blender.infinigen import import_infinigen, silence

# What each part is made of: the first pattern that is found in "generator/part" names the family.
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
    # Other generators, by the words in their parts' names
    ("wood|plank|timber|oak", "wood"),
    ("metal|steel|iron|brass|chrome|copper", "metal"),
    ("fabric|cloth|shade|cushion|textile|seat|leather", "upholstery"),
    ("ceramic|porcelain|clay|pot|vase", "ceramic"),
    ("leaf|leaves|stem|grass|green", "green"),
    ("petal|flower", "petal"),
)
NEUTRAL = "plastic"  # what no pattern names

# One of each family is drawn, the same for all parts of a family; Infinigen's own weights are about the same.
FAMILIES = {
    "frame": ("materials.wood:Wood", "materials.wood:Wood", "materials.wood:BlondePlywood")
    + ("materials.wood:BlackPlywood", "materials.metal:BrushedMetal", "materials.plastic:PlasticRough"),
    "upholstery": ("materials.fabric:FineKnitFabric", "materials.fabric:CoarseKnitFabric", "materials.fabric:Leather")
    + ("materials.wood:Wood", "materials.plastic:PlasticRough"),
    "table top": ("materials.wood:Wood", "materials.wood:TableWood", "materials.ceramic:Marble")
    + ("materials.plastic:PlasticRough",),
    "wood": ("materials.wood:Wood", "materials.wood:TableWood", "materials.wood:BlondePlywood"),
    "metal": ("materials.metal:MetalBasic", "materials.metal:BrushedMetal", "materials.metal:GalvanizedMetal"),
    "ceramic": ("materials.ceramic:Ceramic", "materials.ceramic:VaseCeramic", "materials.ceramic:Marble"),
    "basket": ("materials.plastic:PlasticRough", "materials.plastic:PlasticRough", "materials.wood:Wood"),
    "plastic": ("materials.plastic:PlasticRough",),
    "petal": ("objects.grassland.flower:shader_petal",),
    "flower centre": ("objects.grassland.flower:shader_flower_center",),
    "green": ("materials.plant.simple_greenery:shader_simple_greenery",),
    "white": ("materials.plant.simple_whitish:shader_simple_white",),
}


def family(generator: str, part: str) -> str:
    """What a part is made of, by its name and the name or path of its generator."""
    name = f"{Path(generator).stem}/{part}".lower()
    return next((kind for pattern, kind in PARTS if re.search(pattern, name)), NEUTRAL)


def materials(generator: str, part_names: tuple[str, ...], seed: int) -> list[Any]:
    """Blender's materials for the parts, in their order, drawn with the seed."""
    families = [family(generator, part) for part in part_names]
    made = {kind: _draw(kind, seed) for kind in dict.fromkeys(families)}
    return [made[kind] for kind in families]


def _draw(kind: str, seed: int) -> Any:
    import_infinigen("infinigen.core.surface")
    from infinigen.core import surface
    from infinigen.core.util.math import FixedSeed

    rng = np.random.default_rng([seed, *kind.encode()])  # a seat's colour says nothing of the legs'
    module, name = str(rng.choice(FAMILIES[kind])).split(":")
    with FixedSeed(int(rng.integers(2**31))):
        maker = getattr(import_infinigen(f"infinigen.assets.{module}"), name)
        with silence():
            made = maker().generate() if isinstance(maker, type) else surface.shaderfunc_to_material(maker)
    made.name = f"{kind}: {name}"
    return made
