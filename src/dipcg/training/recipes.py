"""The paper's system and its ablations as settings: `dipcg train --recipe NAME`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from dipcg.camera import ViewGrid
from dipcg.config import AugmentConfig, ModelConfig, TrainConfig


@dataclass(frozen=True)
class Recipe:
    """The settings of a network and of its training, and the paper's results for them on ShapeNet's chairs."""

    about: str
    model: ModelConfig = field(default_factory=ModelConfig)
    train: TrainConfig = field(default_factory=TrainConfig)
    published: tuple[float, float, float] | None = None
    """Chamfer distance, earth mover's distance and F-score in table 2 of the paper"""


# Section 3.2 lists the changes to pictures, but not how often each is made; these shares are ours.
_PAPER_AUGMENTATION = {"mask": 0.1, "edges": 0.1, "colour": 0.8, "crop": 0.8, "flip": 0.5}
_NO_AUGMENTATION = AugmentConfig(**dict.fromkeys(AugmentConfig.__dataclass_fields__, 0.0))
_PAPER = Recipe(
    "the paper's: DiT 12 × 192 with DINOv2, 7.6 M weights, 250 steps",
    ModelConfig(encoder="dinov2", width=192, depth=12, heads=6, summary=0, objective="ddpm", steps=250),
    TrainConfig(
        pictures=50_000_000,
        batch=128,
        optimiser="adamw",
        learning_rate=1e-4,
        schedule="constant",
        weight_decay=0.0,
        draws=1,
        lock=0.0,
        grow=False,
        ema=0.9999,
        views="grid",
        augment=replace(_NO_AUGMENTATION, views=1.0, **_PAPER_AUGMENTATION),
    ),
    (0.093, 0.108, 0.452),
)


def _variant(
    about: str, published: tuple[float, float, float], train: TrainConfig = _PAPER.train, **model: object
) -> Recipe:
    return Recipe(about, replace(_PAPER.model, **model), train, published)  # type: ignore[arg-type]


RECIPES = {
    "ours": Recipe("the default: flow matching with a first guess, 10 steps"),
    "paper": _PAPER,
    "single-view": _variant(
        "the paper's with one view and without augmentation",
        (0.139, 0.140, 0.321),
        replace(_PAPER.train, augment=_NO_AUGMENTATION),
    ),
    "clip": _variant("the paper's with CLIP instead of DINOv2", (0.161, 0.163, 0.288), encoder="clip"),
    "small": _variant("the paper's with 1.6 M weights", (0.108, 0.121, 0.423), width=128, depth=5, heads=4),
    "large": _variant("the paper's with 39 M weights", (0.094, 0.110, 0.452), width=384, depth=16, heads=12),
}

# The published cameras of each generator; the elevation above the horizon is 90° minus the published polar angle.
_PUBLISHED_VIEWS = {
    "chair": ViewGrid((0, 30, 60, 80), (10, 30, 40), (1.8, 2.0)),
    "table": ViewGrid((0, 30, 60, 90), (20, 30), (5.0, 6.0)),
    "vase": ViewGrid((0,), (0, 10, 30), (1.2, 1.6, 2.0)),
    "basket": ViewGrid((30, 60), (20, 30, 40), (1.2, 1.6)),
    "flower": ViewGrid((0,), (10, 30, 40, 60), (2.0, 3.0, 4.0)),
    "dandelion": ViewGrid((0,), (0,), (3.0,)),
}
# The cameras in section 3.2 of the paper.
_PAPER_VIEWS = ViewGrid((0, 30, 60), (30, 60), (1.8, 2.0))


def published_views(generator: str) -> ViewGrid:
    """The published cameras of a generator, or those of the paper's text for one without published cameras."""
    return _PUBLISHED_VIEWS.get(generator, _PAPER_VIEWS)


def find_recipe(name: str) -> Recipe:
    """The recipe of this name. Raises ValueError that lists the recipes when there is none."""
    if name not in RECIPES:
        raise ValueError(f"There is no recipe {name!r}. There are: {', '.join(RECIPES)}.")
    return RECIPES[name]
