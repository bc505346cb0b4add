"""Infinigen's procedural materials for the parts of our meshes; it runs in a child process with Blender."""

from __future__ import annotations

from typing import Any

import numpy as np

from dipcg.blender.infinigen import import_infinigen, silence
from dipcg.materials import FAMILIES, family


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
    module, name = str(rng.choice(FAMILIES[kind].infinigen)).split(":")
    with FixedSeed(int(rng.integers(2**31))):
        maker = getattr(import_infinigen(f"infinigen.assets.{module}"), name)
        with silence():
            made = maker().generate() if isinstance(maker, type) else surface.shaderfunc_to_material(maker)
    made.name = f"{kind}: {name}"
    return made
