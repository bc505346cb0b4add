"""The command for people who hold weights that were trained elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from dipcg.cli.assets import Name, Output
from dipcg.model.zoo import RUNS

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

    from dipcg.model.checkpoint import write_checkpoint
    from dipcg.generators import load_generator
    from dipcg.model.convert import convert, read_weights

    made = load_generator(generator)
    network, config = convert(read_weights(file), made.space, encoder, heads)
    folder = output / f"{made.name}-imported"
    weights = {f"denoiser.{name}": value for name, value in network.state_dict().items()}
    about = {"imported": {"file": file.name, "notice": NOTICE}}
    write_checkpoint(folder, weights, replace(config, encoder_weights=encoder_weights), made, about)
    print(f"{NOTICE}\nWrote {folder}. Try: dipcg estimate PICTURE -g {folder} -o out.glb")
