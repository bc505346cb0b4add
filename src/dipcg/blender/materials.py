"""Infinigen's procedural materials for the parts of our meshes; it runs in a child process with Blender."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from dipcg.blender.infinigen import import_infinigen, silence

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

# One material of each family is drawn, the same for all its parts, with about Infinigen's own weights.
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
    """The family of a part's material, from its name and the name or path of its generator."""
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

    # Each family draws on its own, so that the colour of a seat does not decide that of the legs.
    rng = np.random.default_rng([seed, *kind.encode()])
    module, name = str(rng.choice(FAMILIES[kind])).split(":")
    with FixedSeed(int(rng.integers(2**31))):
        maker = getattr(import_infinigen(f"infinigen.assets.{module}"), name)
        with silence():
            made = maker().generate() if isinstance(maker, type) else surface.shaderfunc_to_material(maker)
    made.name = f"{kind}: {name}"
    return made
