"""The stages of a training in its folder: ranges are proposed, edited ranges are tried, an estimator is trained."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dipcg.app.training_folder import FOUND, Training
from dipcg.app.uploads import GIVEN
from dipcg.files import write_file

Order = dict[str, Any]
Report = Callable[[float, str], None]

# The share of the work that is the data set, and how many samples are drawn for people.
DATA_SHARE, SAMPLES, SIDE = 0.3, 6, 256
WORKERS = 2
# The checkpoint that a training begins with, since its network knows what pictures look like.
START = "chair"


def propose(folder: Path, order: Order, report: Report) -> None:
    """Propose parameters and ranges, and draw samples."""
    training = Training(folder)
    toml = training.toml
    toml.unlink(missing_ok=True)
    made = _imported(folder / order["file"], order, toml, report)
    shutil.copy(toml, training.proposed)
    values = {row.name: row.value for row in made.rows}
    write_file(folder / FOUND, json.dumps({"values": values, "left_out": made.left_out, "notes": made.notes}))
    _draw_samples(training, report)


def edit(folder: Path, order: Order, report: Report) -> None:
    """Take edited ranges, and draw samples; what was learned with other ranges goes."""
    from dipcg.importing.editing import edited, read_parameters, write_edited

    training = Training(folder)
    entries = edited(read_parameters(training.proposed), order["ranges"], order["hold"])
    for made in (training.data, training.checkpoint):
        shutil.rmtree(made, ignore_errors=True)
    write_edited(training.toml, training.proposed, entries)
    _draw_samples(training, report)


def learn(folder: Path, order: Order, report: Report) -> None:
    """Build the data set and train; both go on where they were."""
    from dipcg.config import ModelConfig, TrainConfig
    from dipcg.data.store import Local, Progress, build_dataset
    from dipcg.model.zoo import shipped
    from dipcg.training.train import Status as Trained
    from dipcg.training.train import train

    training, count = Training(folder), order["shapes"]
    settings = TrainConfig(minutes=order["minutes"], start=START if START in shipped() else "")

    def built(progress: Progress) -> None:
        report(DATA_SHARE * progress.done / count, f"Building shape {progress.done} of {count}")

    def trained(status: Trained) -> None:
        note = f"Training: loss {status.loss:.3f}, {status.pictures_per_s:.0f} pictures per second"
        report(DATA_SHARE + (1 - DATA_SHARE) * status.share, note)

    build_dataset(str(training.toml), training.data, count, executor=Local(WORKERS), report=built)
    train(training.data, training.checkpoint, settings, ModelConfig(), trained)


def _imported(source: Path, order: Order, toml: Path, report: Report) -> Any:
    if source.suffix == ".blend":
        return _from_blend(source, order, toml, report)
    if source.suffix == ".scad":
        from dipcg.importing.openscad import import_scad

        report(0.0, "Trying ranges")
        return import_scad(source, toml)
    from dipcg.importing.seeded import import_program

    report(0.0, "Recording the random draws")
    return import_program(str(source), "", {}, toml)


def _from_blend(source: Path, order: Order, toml: Path, report: Report) -> Any:
    from dipcg.importing.blend import Options, import_blend
    from dipcg.importing.given import take_given
    from dipcg.importing.program import program_for

    program, given = program_for(source, order["blender"]), source.parent / GIVEN
    if given.is_file():
        report(0.0, "Reading the inputs")
        return take_given(source, given, toml, program)
    options = Options(order["object"], order["modifier"], program)
    return import_blend(source, options, toml, lambda count: report(0.0, f"Trying ranges: {count} builds"))


def _draw_samples(training: Training, report: Report) -> None:
    """Pictures of random samples; those that cannot be built are left out."""
    from dipcg.generators import load_generator
    from dipcg.images import MARGIN, save_image
    from dipcg.mesh import Mesh
    from dipcg.render import Renderer
    from dipcg.workers.pool import BuildPool

    pictures, renderer = training.samples, Renderer(SIDE)
    shutil.rmtree(pictures, ignore_errors=True)
    pictures.mkdir()
    generator = load_generator(str(training.toml))
    rng = np.random.default_rng()
    with BuildPool(generator, WORKERS) as pool, contextlib.closing(renderer):
        many = [generator.space.sample(rng) for _ in range(SAMPLES)]
        for number, mesh in enumerate(pool.map(many, "light")):
            report(0.9, f"Drawing sample {number + 1} of {SAMPLES}")
            if isinstance(mesh, Mesh):
                image = renderer.render(mesh, generator.seen_from(many[number]).middle, margin=MARGIN)
                save_image(image, pictures / f"{number}.png")
