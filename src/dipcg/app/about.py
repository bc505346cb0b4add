"""What the server says of itself: generators, formats, limits and examples."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import dipcg
from dipcg.app import limits, models
from dipcg.app.making import endings
from dipcg.app.studio import Studio
from dipcg.app.trainings import Trainings
from dipcg.export.asset import TEXTURED
from dipcg.generators import Detail
from dipcg.labels import label, option_labels
from dipcg.space import Choice, Parameter, Real

# The pictures that ship: beside the package when it is installed, in examples/ of a checkout.
EXAMPLES = (Path(__file__).parents[1] / "examples", Path(__file__).parents[3] / "examples" / "images")
# The other pictures are named after their generators.
ALSO_CHAIRS = {"armchair": "chair", "sketch": "chair"}


def about(studio: Studio, trainings: Trainings) -> models.About:
    """Formats, limits and examples."""
    formats = endings()
    return models.About(
        version=dipcg.__version__,
        formats=formats,
        textures=[suffix for suffix in TEXTURED if suffix in formats],
        details=list(get_args(Detail)),
        limits={
            "picture_bytes": limits.MOST_PICTURE_BYTES,
            "candidates": limits.MOST_CANDIDATES,
            "letters": limits.MOST_LETTERS,
            "texture": limits.MOST_TEXTURE,
            "faces": limits.MOST_FACES,
            "source_bytes": limits.MOST_SOURCE_BYTES,
            "shapes": limits.MOST_SHAPES,
            "minutes": limits.MOST_MINUTES,
        },
        examples=[_example(path) for path in example_images(studio.names)],
        words=any(studio.reads_text(name) for name in studio.names),
        learns=trainings.is_open,
        takes_code=trainings.takes_code,
    )


def generator(studio: Studio, name: str) -> models.GeneratorAnswer:
    """A generator with its declared parameters."""
    found = studio.generator(name)
    return models.GeneratorAnswer(
        name=name,
        label=name.replace("_", " "),
        ref=found.ref,
        doc=found.doc.partition("\n")[0],
        reads_text=studio.reads_text(name),
        parameters=[_parameter(p, found.inputs.get(p.name, ("", ""))) for p in found.space],
    )


def _parameter(p: Parameter, setting: tuple[str, str]) -> models.Parameter:
    ends = {"low": float(p.low), "high": float(p.high)} if isinstance(p, Real) else {}
    labels = zip(p.options, option_labels(p), strict=True) if isinstance(p, Choice) else ()
    return models.Parameter(
        name=p.name,
        label=label(p),
        part=p.group or "parameters",
        kind="real" if isinstance(p, Real) else "choice",
        unit=p.unit,
        options=[models.Option(value=value, label=words) for value, words in labels],
        doc=p.doc,
        inactive=p.inactive,
        when={name: list(allowed) for name, allowed in p.when.items()},
        input=setting[0],
        component=setting[1],
        **ends,
    )


def example_images(names: list[str]) -> list[Path]:
    """The pictures that ship of these generators."""
    found = next((found for folder in EXAMPLES if (found := sorted(folder.glob("*.png")))), [])
    return [path for path in found if ALSO_CHAIRS.get(path.stem, path.stem) in names]


def _example(path: Path) -> models.Example:
    return models.Example(name=path.stem, label=path.stem.replace("_", " "), url=f"/api/v1/examples/{path.name}")
