"""Converted weights: the network gives the same output as a plain implementation with the published names."""

import math

import pytest
import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from torch import Tensor

from dipcg.cli import main
from dipcg.generators import load_generator
from dipcg.model.checkpoint import load_checkpoint
from dipcg.model.convert import convert, read_weights
from dipcg.model.zoo import CheckpointError

SPACE = load_generator("box").space
WIDTH, DEPTH, CHANNELS = 64, 3, 32


@pytest.fixture(scope="module")
def published() -> dict[str, Tensor]:
    """Random weights under the published names."""
    random = torch.Generator().manual_seed(0)
    w = WIDTH
    shapes = {
        "pos_embed": (1, len(SPACE), w),
        "x_embedder.weight": (w, 1),
        "x_embedder.bias": (w,),
        "y_embedder.y_embedding": (257, CHANNELS),
    }
    layers = {
        "t_embedder.mlp.0": (256, w),
        "t_embedder.mlp.2": (w, w),
        "t_block.1": (w, 6 * w),
        "y_embedder.y_proj.fc1": (CHANNELS, w),
        "y_embedder.y_proj.fc2": (w, w),
        "final_layer.linear": (w, 2),
    }
    shapes["final_layer.scale_shift_table"] = (2, w)
    for i in range(DEPTH):
        shapes[f"blocks.{i}.scale_shift_table"] = (6, w)
        layers |= {f"blocks.{i}.attn.qkv": (w, 3 * w), f"blocks.{i}.attn.proj": (w, w)}
        layers |= {f"blocks.{i}.cross_attn.q_linear": (w, w), f"blocks.{i}.cross_attn.kv_linear": (w, 2 * w)}
        layers |= {f"blocks.{i}.cross_attn.proj": (w, w)}
        layers |= {f"blocks.{i}.mlp.fc1": (w, 4 * w), f"blocks.{i}.mlp.fc2": (4 * w, w)}
    for name, (inputs, outputs) in layers.items():
        shapes |= {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}
    return {name: 0.3 * torch.randn(shape, generator=random) / max(shape) ** 0.25 for name, shape in shapes.items()}


def reference_network(p: dict[str, Tensor], x: Tensor, t: Tensor, tokens: Tensor) -> Tensor:
    """The output `b n 2` of the published network, layer by layer: noise, and fraction of the log variance."""

    def layer(name: str, values: Tensor) -> Tensor:
        return values @ p[f"{name}.weight"].T + p[f"{name}.bias"]

    def norm(values: Tensor) -> Tensor:
        return (values - values.mean(-1, keepdim=True)) / (values.var(-1, unbiased=False, keepdim=True) + 1e-6).sqrt()

    def gelu(values: Tensor) -> Tensor:
        return 0.5 * values * (1 + torch.tanh(math.sqrt(2 / math.pi) * (values + 0.044715 * values**3)))

    def attention(q: Tensor, k: Tensor, v: Tensor) -> Tensor:
        mixed = []
        for head in range(WIDTH // 32):
            part = slice(32 * head, 32 * head + 32)
            weights = (q[..., part] @ k[..., part].transpose(1, 2) / 32**0.5).softmax(-1)
            mixed.append(weights @ v[..., part])
        return torch.cat(mixed, -1)

    rates = torch.exp(-math.log(10_000) * torch.arange(128) / 128)
    angles = t[:, None].float() * rates
    time = layer("t_embedder.mlp.2", F.silu(layer("t_embedder.mlp.0", torch.cat([angles.cos(), angles.sin()], 1))))
    shared = layer("t_block.1", F.silu(time)).reshape(len(x), 6, WIDTH)
    y = layer("y_embedder.y_proj.fc2", gelu(layer("y_embedder.y_proj.fc1", tokens)))
    h = layer("x_embedder", x[..., None]) + p["pos_embed"]
    for i in range(DEPTH):
        at = f"blocks.{i}."
        shift, scale, gate, shift_m, scale_m, gate_m = (
            (p[at + "scale_shift_table"][None] + shared)[:, j : j + 1] for j in range(6)
        )
        q, k, v = layer(at + "attn.qkv", norm(h) * (1 + scale) + shift).split(WIDTH, -1)
        h = h + gate * layer(at + "attn.proj", attention(q, k, v))
        k, v = layer(at + "cross_attn.kv_linear", y).split(WIDTH, -1)
        h = h + layer(at + "cross_attn.proj", attention(layer(at + "cross_attn.q_linear", h), k, v))
        inner = gelu(layer(at + "mlp.fc1", norm(h) * (1 + scale_m) + shift_m))
        h = h + gate_m * layer(at + "mlp.fc2", inner)
    shift, scale = ((p["final_layer.scale_shift_table"][None] + time[:, None])[:, j : j + 1] for j in range(2))
    return layer("final_layer.linear", norm(h) * (1 + scale) + shift)


def inputs(channels: int = CHANNELS) -> tuple[Tensor, Tensor, Tensor]:
    random = torch.Generator().manual_seed(1)
    tokens = torch.randn(3, 17, channels, generator=random)
    return torch.randn(3, len(SPACE), generator=random), torch.tensor([0, 400, 999]), tokens


@torch.no_grad()
def test_converted_weights_give_the_output_of_the_reference(published):
    network, config = convert(published, SPACE, "dinov2")
    x, t, tokens = inputs()
    expected = reference_network(published, x, t, tokens)
    assert expected.std() > 0.05
    output = torch.stack(network(x, t, network.keys_values(tokens)), -1)
    torch.testing.assert_close(output, expected, rtol=1e-4, atol=1e-4)
    assert (config.width, config.depth, config.heads, config.steps) == (WIDTH, DEPTH, WIDTH // 32, 250)


@torch.no_grad()
def test_the_command_writes_a_checkpoint_with_the_same_output(published, pretrained, tmp_path, capsys):
    save_file({f"module.{name}": value for name, value in published.items()}, tmp_path / "published.safetensors")
    words = ["-g", "box", "-o", str(tmp_path), "--encoder-weights", pretrained["dinov2"]]
    main(["import-checkpoint", str(tmp_path / "published.safetensors"), *words])
    assert "licence is that of the people who trained them" in capsys.readouterr().out
    model, generator, card = load_checkpoint(tmp_path / "box-imported")
    assert (generator.name, card["model"]["objective"]) == ("box", "ddpm")
    x, t, tokens = inputs()
    output = torch.stack(model.denoiser(x, t, model.denoiser.keys_values(tokens)), -1)
    # The checkpoint has half precision.
    torch.testing.assert_close(output, reference_network(published, x, t, tokens), rtol=0, atol=0.02)


def test_an_error_names_the_weights_that_do_not_fit(published):
    def refused(weights: dict[str, Tensor], space=SPACE) -> str:
        with pytest.raises(CheckpointError) as error:
            convert(weights, space, "dinov2")
        return str(error.value)

    assert "for 8 parameters, and this generator has 48" in refused(published, load_generator("chair").space)
    assert "no weight 'blocks.0.attn.lora'" in refused(published | {"blocks.0.attn.lora": torch.zeros(1)})
    short = {name: value for name, value in published.items() if name != "t_block.1.bias"}
    assert "missing are modulation.1.bias" in refused(short)
    assert "of another shape are leave.weight" in refused(
        published | {"final_layer.linear.weight": torch.zeros(1, WIDTH)}
    )
    assert "not all finite" in refused(published | {"x_embedder.bias": torch.full((WIDTH,), math.nan)})


def test_pickles_are_not_opened(tmp_path):
    (tmp_path / "published.pt").write_bytes(b"\x80\x04.")
    with pytest.raises(CheckpointError, match=r"opens no pickles.*convert it once: python -c"):
        read_weights(tmp_path / "published.pt")
    (tmp_path / "cut.safetensors").write_bytes(b"123")
    with pytest.raises(CheckpointError, match="cannot be read as safetensors"):
        read_weights(tmp_path / "cut.safetensors")
