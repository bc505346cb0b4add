"""Converts weights with the published names, which are those of PixArt-α, into the network of the paper's recipe.

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
# The width of an attention head in the paper: 192 channels over 6 heads.
HEAD_WIDTH = 32
# Training scripts may put one of these before the name of every weight.
PREFIXES = ("module.", "model.", "ema.")
# The embedding of an absent picture serves classifier-free guidance, which this package does not use.
UNUSED = ("y_embedder.y_embedding",)
# The owner of a pickle runs this line, because this package opens no pickle.
TO_SAFETENSORS = (
    'python -c "import sys, torch; from safetensors.torch import save_file; '
    "w = torch.load(sys.argv[1], map_location='cpu', weights_only=True); w = w.get('ema', w.get('model', w)); "
    'save_file({k: v.contiguous() for k, v in w.items()}, sys.argv[2])" FILE weights.safetensors'
)
# Patterns of the published names, and the names in `DiT`. `_split` then divides `qkv`.
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
    """The tensors of a safetensors file by name, without the prefix of a training script.

    Raises CheckpointError for any other file, with the line that converts a pickle from a trusted source.
    """
    if path.suffix != ".safetensors":
        raise CheckpointError(
            f"{path} is not safetensors, and dipcg opens no pickles, which can run any code. "
            f"If you trust its maker, convert it once: {TO_SAFETENSORS}"
        )
    try:
        weights = load_file(path)
    except (OSError, SafetensorError) as error:
        raise CheckpointError(f"{path} cannot be read as safetensors ({error}).") from None
    for prefix in PREFIXES:
        if weights and all(name.startswith(prefix) for name in weights):
            weights = {name.removeprefix(prefix): value for name, value in weights.items()}
    return weights


def convert(
    published: Weights, space: ParameterSpace, encoder: str, heads: int | None = None
) -> tuple[DiT, ModelConfig]:
    """The network with these weights and its configuration; the parameters of `space` are in their published order.

    The shapes of the weights do not show the number of attention heads. Without `heads` each has 32 channels, as in the
    paper. Raises CheckpointError that lists the weights that do not fit.
    """
    weights = _renamed(published)
    try:
        channels, width = weights["project.0.weight"].shape[1], len(weights["enter.bias"])
    except KeyError as error:
        raise CheckpointError(f"The weights have no {error}; they are not of the published layout.") from None
    depth = len({name.split(".")[1] for name in weights if name.startswith("blocks.")})
    heads = heads or max(1, width // HEAD_WIDTH)
    config = ModelConfig(encoder, width=width, depth=depth, heads=heads, summary=0, objective="ddpm", steps=250)
    network = DiT(len(space), channels, config)
    _check_shapes(weights, network, space)
    network.load_state_dict(weights)
    return network.eval(), config


def _renamed(published: Weights) -> Weights:
    weights: Weights = {}
    for name, value in published.items():
        if name not in UNUSED:
            weights |= _split(_network_name(name), value.float())
    for name in [name for name in weights if name.endswith("shift")]:
        weights[name] = weights[name].flatten(0, -2)[:, None]
    if "enter.weight" in weights:
        weights["enter.weight"] = weights["enter.weight"].flatten(1)
    if "position" in weights:
        weights["position"] = weights["position"].flatten(0, -2)
    return weights


def _network_name(name: str) -> str:
    for pattern, replacement in _NAMES.items():
        if re.fullmatch(pattern, name):
            return re.sub(pattern, replacement, name)
    raise CheckpointError(f"The published layout has no weight {name!r}; this file is of another network.")


def _split(name: str, value: Tensor) -> Weights:
    """The weight under its name, or `qkv` as one weight for queries and one for keys and values, as in `Attention`."""
    if ".qkv." not in name:
        return {name: value}
    third = len(value) // 3
    return {name.replace("qkv", "queries"): value[:third], name.replace("qkv", "pairs"): value[third:]}


def _check_shapes(weights: Weights, network: DiT, space: ParameterSpace) -> None:
    expected = network.state_dict()
    weights.setdefault("position", positions(len(space), expected["enter.bias"].shape[0]))
    if len(weights["position"]) != len(space):
        raise CheckpointError(
            f"The weights are for {len(weights['position'])} parameters, and this generator has {len(space)}."
        )
    missing = sorted(expected.keys() - weights.keys())
    mismatched = [f"{k} {tuple(v.shape)}" for k, v in weights.items() if k in expected and v.shape != expected[k].shape]
    unknown = sorted(weights.keys() - expected.keys())
    problems = {"missing are": missing, "of another shape are": mismatched, "unknown are": unknown}
    if any(problems.values()):
        listed = "; ".join(f"{problem} {', '.join(names[:3])}" for problem, names in problems.items() if names)
        raise CheckpointError(f"The weights do not fit the paper's network: {listed}.")
    if not all(torch.isfinite(value).all() for value in weights.values()):
        raise CheckpointError("The weights are not all finite numbers; the file is damaged.")
