"""Weights in the published layout of this kind of network (PixArt-α's names) as a checkpoint of the paper's recipe.

Only tensors are read, from safetensors; no pickle is ever opened.
"""

from __future__ import annotations

import re
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from dipcg.config import ModelConfig
from dipcg.model.dit import DiT, positions
from dipcg.model.zoo import CheckpointError
from dipcg.space import ParameterSpace

Weights = dict[str, Tensor]
HEAD = 32  # numbers in an attention head: the paper's 192 over 6
WRAPPINGS = ("module.", "model.", "ema.")  # what training scripts put before every name
UNUSED = ("y_embedder.y_embedding",)  # stands for "no picture", which is never asked for here
TO_SAFETENSORS = (
    'python -c "import sys, torch; from safetensors.torch import save_file; '
    "w = torch.load(sys.argv[1], map_location='cpu', weights_only=True); w = w.get('ema', w.get('model', w)); "
    'save_file({k: v.contiguous() for k, v in w.items()}, sys.argv[2])" FILE weights.safetensors'
)
_NAMES = {
    r"x_embedder\.(?:proj\.)?(weight|bias)": r"enter.\1",
    r"pos_embed": "position",
    r"t_embedder\.mlp\.([02])\.(weight|bias)": r"time.\1.\2",
    r"t_block\.1\.(weight|bias)": r"modulation.1.\1",
    r"y_embedder\.y_proj\.fc1\.(weight|bias)": r"project.0.\1",
    r"y_embedder\.y_proj\.fc2\.(weight|bias)": r"project.2.\1",
    r"blocks\.(\d+)\.scale_shift_table": r"blocks.\1.shift",
    r"blocks\.(\d+)\.attn\.qkv\.(weight|bias)": r"blocks.\1.attend.qkv.\2",
    r"blocks\.(\d+)\.attn\.proj\.(weight|bias)": r"blocks.\1.attend.output.\2",
    r"blocks\.(\d+)\.cross_attn\.q_linear\.(weight|bias)": r"blocks.\1.cross.queries.\2",
    r"blocks\.(\d+)\.cross_attn\.kv_linear\.(weight|bias)": r"blocks.\1.cross.pairs.\2",
    r"blocks\.(\d+)\.cross_attn\.proj\.(weight|bias)": r"blocks.\1.cross.output.\2",
    r"blocks\.(\d+)\.mlp\.fc1\.(weight|bias)": r"blocks.\1.mlp.0.\2",
    r"blocks\.(\d+)\.mlp\.fc2\.(weight|bias)": r"blocks.\1.mlp.2.\2",
    r"final_layer\.scale_shift_table": "shift",
    r"final_layer\.linear\.(weight|bias)": r"leave.\1",
}


def read_weights(path: Path) -> Weights:
    """Tensors of a safetensors file, without what a training script put before their names.

    Raises CheckpointError for any other file, with the line that converts a pickle where its maker is trusted.
    """
    if path.suffix != ".safetensors":
        raise CheckpointError(
            f"{path} is not safetensors, and dipcg opens no pickles, which can run any code. "
            f"If you trust its maker, convert it once: {TO_SAFETENSORS}"
        )
    try:
        found = load_file(path)
    except (OSError, SafetensorError) as error:
        raise CheckpointError(f"{path} cannot be read as safetensors ({error}).") from None
    for wrapping in WRAPPINGS:
        if found and all(name.startswith(wrapping) for name in found):
            found = {name.removeprefix(wrapping): value for name, value in found.items()}
    return found


def convert(
    published: Weights, space: ParameterSpace, encoder: str, heads: int | None = None
) -> tuple[DiT, ModelConfig]:
    """The network with these weights, for the parameters of a space in their published order.

    `heads` cannot be read from weights; left out, they have 32 numbers each, as in the paper. Raises CheckpointError
    with what does not fit.
    """
    weights = _renamed(published)
    try:
        channels, width = weights["project.0.weight"].shape[1], len(weights["enter.bias"])
    except KeyError as error:
        raise CheckpointError(f"The weights have no {error}; they are not of the published layout.") from None
    depth = len({name.split(".")[1] for name in weights if name.startswith("blocks.")})
    heads = heads or max(1, width // HEAD)
    config = ModelConfig(encoder, width=width, depth=depth, heads=heads, summary=0, objective="ddpm", steps=250)
    network = DiT(len(space), channels, config)
    _check_shapes(weights, network, space)
    network.load_state_dict(weights)
    return network.eval(), config


def _renamed(published: Weights) -> Weights:
    weights: Weights = {}
    for name, value in published.items():
        if name not in UNUSED:
            weights |= _split(_our_name(name), value.float())
    for name in [name for name in weights if name.endswith("shift")]:
        weights[name] = weights[name].flatten(0, -2)[:, None]
    if "enter.weight" in weights:
        weights["enter.weight"] = weights["enter.weight"].flatten(1)
    if "position" in weights:
        weights["position"] = weights["position"].flatten(0, -2)
    return weights


def _our_name(name: str) -> str:
    for pattern, ours in _NAMES.items():
        if re.fullmatch(pattern, name):
            return re.sub(pattern, ours, name)
    raise CheckpointError(f"The published layout has no weight {name!r}; this file is of another network.")


def _split(name: str, value: Tensor) -> Weights:
    """Queries apart from keys and values, which are computed ahead for cross-attention and share the code."""
    if ".qkv." not in name:
        return {name: value}
    third = len(value) // 3
    return {name.replace("qkv", "queries"): value[:third], name.replace("qkv", "pairs"): value[third:]}


def _check_shapes(weights: Weights, network: DiT, space: ParameterSpace) -> None:
    wanted = network.state_dict()
    weights.setdefault("position", positions(len(space), wanted["enter.bias"].shape[0]))
    if len(weights["position"]) != len(space):
        raise CheckpointError(
            f"The weights are for {len(weights['position'])} parameters, and this generator has {len(space)}."
        )
    missing = sorted(wanted.keys() - weights.keys())
    unlike = [f"{k} {tuple(v.shape)}" for k, v in weights.items() if k in wanted and v.shape != wanted[k].shape]
    unknown = sorted(weights.keys() - wanted.keys())
    if missing or unlike or unknown:
        told = "; ".join(f"{what} {', '.join(names[:3])}" for what, names in _problems(missing, unlike, unknown))
        raise CheckpointError(f"The weights do not fit the paper's network: {told}.")
    if not all(torch.isfinite(value).all() for value in weights.values()):
        raise CheckpointError("The weights are not all finite numbers; the file is damaged.")


def _problems(missing: list[str], unlike: list[str], unknown: list[str]) -> list[tuple[str, list[str]]]:
    told = [("missing are", missing), ("of another shape are", unlike), ("unknown are", unknown)]
    return [(what, names) for what, names in told if names]
