"""The commands that make checkpoints: train, import-checkpoint."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from dipcg.cli.assets import Name, Output
from dipcg.cli.code import ALLOW
from dipcg.cli.outputs import check_outputs
from dipcg.config import ModelConfig, TrainConfig
from dipcg.model.zoo import RUNS, WEIGHTS, find_checkpoint


def train(
    generator: Positional[str],
    /,
    *,
    data: Path,
    output: Output = RUNS,
    recipe: str = "ours",
    train: Annotated[TrainConfig, arg(name="")] = TrainConfig(),  # noqa: B008 - frozen
    model: Annotated[ModelConfig, arg(name="")] = ModelConfig(),  # noqa: B008 - frozen
) -> None:
    """Train an estimator on a data set; a killed run goes on where it was.

    Args:
        generator: name, or a path to a Python or TOML file; its checkpoint goes to a folder of this name in the output
        data: folder from `dipcg dataset build`
        output: folder for checkpoints
        recipe: ours, paper, single-view, clip, small or large; what the flags below default to
    """
    from dipcg.cli.terminal import bar
    from dipcg.data.store import Store
    from dipcg.generators import load_generator
    from dipcg.training.log import Log
    from dipcg.training.recipes import find_recipe
    from dipcg.training.state import WEIGHTS as STATE
    from dipcg.training.state import saved
    from dipcg.training.train import train as run

    find_recipe(recipe)
    info = Store(data).info
    if generator != info["generator"] and load_generator(generator).ref != info["ref"]:
        raise ValueError(f"{data} holds shapes of {info['generator']!r}, not of {generator!r}.")
    folder = output / info["generator"]
    check_outputs((folder / WEIGHTS,), (find_checkpoint(train.start) if train.start else None,))
    if (folder / STATE).is_file():
        print(f"{saved(folder)} Training goes on from there.", file=sys.stderr)
    with _ends_as_interrupted(), bar("training", 1000) as update, Log(folder, data) as log:

        def report(status: Any) -> None:
            update(int(1000 * status.share), f"loss {status.loss:.3f}, {status.pictures_per_s:.0f} pictures/s")
            log(status)

        try:
            run(data, folder, train, model, report)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"{saved(folder)} The same command goes on from there.") from None
    allow = f" {ALLOW} {info['ref']}" if info["ref"].endswith(".py") else ""
    print(f"Wrote the best weights to {folder}. Try: dipcg estimate PICTURE -g {folder} -o out.glb{allow}")


@contextlib.contextmanager
def _ends_as_interrupted() -> Iterator[None]:
    """A run that is asked to end (SIGTERM) saves its state, as an interrupted one does."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


NOTICE = (
    "These weights are not dipcg's: their licence is that of the people who trained them. Ask them before you share."
)


def import_checkpoint(
    file: Positional[Path],
    /,
    *,
    generator: Name,
    output: Output = RUNS,
    encoder: Literal["dinov2", "clip"] = "dinov2",
    encoder_weights: str = "",
    heads: int | None = None,
) -> None:
    """Make a checkpoint of weights in the published layout of the paper's network.

    Args:
        file: safetensors with the published names (`blocks.0.attn.qkv.weight`, …)
        generator: whose parameters, in the published order, the weights are for
        output: folder for checkpoints; this one goes to NAME-imported in it
        encoder: that the weights were trained with
        encoder_weights: hub name or folder of the encoder's weights
        heads: of attention; one for 32 numbers of the width when left out, as in the paper
    """
    from dataclasses import replace

    from dipcg.generators import load_generator
    from dipcg.model.checkpoint import write_checkpoint
    from dipcg.model.convert import convert, read_weights

    made = load_generator(generator)
    network, config = convert(read_weights(file), made.space, encoder, heads)
    folder = output / f"{made.name}-imported"
    check_outputs((folder / WEIGHTS,), (file,))
    weights = {f"denoiser.{name}": value for name, value in network.state_dict().items()}
    about = {"imported": {"file": file.name, "notice": NOTICE}}
    write_checkpoint(folder, weights, replace(config, encoder_weights=encoder_weights), made, about)
    print(f"{NOTICE}\nWrote {folder}. Try: dipcg estimate PICTURE -g {folder} -o out.glb")
