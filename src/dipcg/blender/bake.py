"""Procedural materials baked to texture maps with Cycles; it runs in a child process.

The value of a shader for a channel (base colour, roughness, metallic) is emitted as light in place of the shader,
because Cycles' own passes mix the colour of a metal with its reflections.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dipcg.blender.infinigen import silence
from dipcg.blender.scene import Report, new_object, start_cycles
from dipcg.materials import srgb
from dipcg.mesh import Mesh
from dipcg.mesh.surface import Maps, corner_normals

# Samples of a texel, of which only the place within it is random.
SAMPLES = 4
# Faces at a larger angle are in different islands of the map.
ISLAND_ANGLE_DEG = 66.0
# The sockets for colours of Blender's mix node, which has a set of sockets for each type of data.
MIXED = {"Factor": 0, "A": 6, "B": 7, "Result": 2}


@dataclass(frozen=True)
class Channel:
    """The inputs of shaders for a channel of the maps, and its value for a shader without any of them."""

    inputs: tuple[str, ...]
    missing: float

    def value(self, node: Any) -> float:
        """The value for a shader without these inputs."""
        return float(node.type == "BSDF_GLOSSY") if "Metallic" in self.inputs else self.missing


CHANNELS = {
    "base_colour": Channel(("Base Color", "Color"), 0.5),
    "roughness": Channel(("Roughness",), 0.8),
    "metallic": Channel(("Metallic",), 0.0),
}


def bake(report: Report, mesh: Mesh, generator: str, seed: int, size: int) -> Maps:
    """Unwrap a mesh without degenerate faces and bake its materials to square maps; raises ValueError."""
    report(0.0, "materials")
    obj = new_object(mesh, generator, seed)
    report(0.1, "unwrapping")
    uv = _unwrap(obj, 2 / size)
    if len(uv) != len(mesh.faces):
        raise ValueError(f"Blender cannot unwrap this mesh: it keeps {len(uv)} of its {len(mesh.faces)} faces.")
    start_cycles(SAMPLES)
    baked = {}
    for step, name in enumerate([*CHANNELS, "normal"]):
        report(0.2 + 0.2 * step, f"baking {name.replace('_', ' ')}")
        baked[name] = _bake(obj, name, size)
    baked["base_colour"] = srgb(baked["base_colour"])
    eight = {name: np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8) for name, image in baked.items()}
    grey = {name: eight[name][..., 0] for name in ("roughness", "metallic")}
    return Maps(uv, corner_normals(mesh), **eight | grey)


def _unwrap(obj: Any, margin: float) -> np.ndarray:
    import bpy

    with silence():
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.uv.smart_project(angle_limit=np.radians(ISLAND_ANGLE_DEG), island_margin=margin, scale_to_bounds=False)
        bpy.ops.object.mode_set(mode="OBJECT")
    uv = np.empty(2 * len(obj.data.loops), np.float32)
    obj.data.uv_layers.active.uv.foreach_get("vector", uv)
    return uv.reshape(-1, 3, 2)


def _bake(obj: Any, name: str, size: int) -> np.ndarray:
    """One map as `s s 3` reals, its first row on top."""
    import bpy

    image = bpy.data.images.new(name, size, size, float_buffer=True, is_data=True)
    trees = [material.node_tree for material in dict.fromkeys(obj.data.materials)]
    for tree in trees:
        tree.nodes.active = tree.nodes.new("ShaderNodeTexImage")
        tree.nodes.active.image = image
        if name in CHANNELS:
            _send_out(tree, CHANNELS[name], name)
    if name not in CHANNELS:
        for tree in trees:
            _restore(tree)
    with silence():
        kind = "EMIT" if name in CHANNELS else "NORMAL"
        bpy.ops.object.bake(type=kind, margin=max(2, size // 64), margin_type="EXTEND", use_clear=True)
    pixels = np.empty(4 * size * size, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(size, size, 4)[::-1, :, :3]


def _send_out(tree: Any, channel: Channel, name: str) -> None:
    """Link an emission of the channel to the surface of a material; the shader stays in the tree, unlinked."""
    output = _output(tree)
    light = tree.nodes.new("ShaderNodeEmission")
    shader = _shader(tree) if "shader" in tree else _linked(output.inputs["Surface"])
    if shader is None:
        raise ValueError("A material has no surface, so there is nothing to bake.")
    tree["shader"], tree["socket"] = shader.node.name, shader.name
    _feed(tree, shader, channel, name, light.inputs["Color"])
    tree.links.new(light.outputs[0], output.inputs["Surface"])


def _restore(tree: Any) -> None:
    tree.links.new(_shader(tree), _output(tree).inputs["Surface"])


def _shader(tree: Any) -> Any:
    """The socket that was linked to the surface of the material before."""
    return tree.nodes[tree["shader"]].outputs[tree["socket"]]


def _output(tree: Any) -> Any:
    return next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL" and node.is_active_output)


def _feed(tree: Any, shader: Any, channel: Channel, name: str, target: Any) -> None:
    """Link the value of the shader at a socket for a channel to `target`, through mixes and groups."""
    node = shader.node if shader else None
    if node is None:
        target.default_value = (channel.missing,) * 3 + (1.0,)
    elif node.type == "MIX_SHADER":
        _feed_mixed(tree, node, channel, name, target)
    elif node.type in ("ADD_SHADER", "REROUTE"):
        _feed(tree, _linked(node.inputs[0]), channel, name, target)
    elif node.type == "GROUP":
        _feed_from_group(tree, node, list(node.outputs).index(shader), channel, name, target)
    else:
        socket = next((node.inputs[key] for key in channel.inputs if key in node.inputs), None)
        _copy(tree, socket, channel.value(node), target)


def _feed_mixed(tree: Any, node: Any, channel: Channel, name: str, target: Any) -> None:
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    _copy(tree, node.inputs[0], 0.5, mix.inputs[MIXED["Factor"]])
    for shader, into in zip(node.inputs[1:3], ("A", "B"), strict=True):
        _feed(tree, _linked(shader), channel, name, mix.inputs[MIXED[into]])
    tree.links.new(mix.outputs[MIXED["Result"]], target)


def _feed_from_group(tree: Any, node: Any, index: int, channel: Channel, name: str, target: Any) -> None:
    inner = node.node_tree
    end = next(one for one in inner.nodes if one.type == "GROUP_OUTPUT" and one.is_active_output)
    if name not in end.inputs:
        inner.interface.new_socket(name, in_out="OUTPUT", socket_type="NodeSocketColor")
        _feed(inner, _linked(end.inputs[index]), channel, name, end.inputs[name])
    tree.links.new(node.outputs[name], target)


def _copy(tree: Any, socket: Any, missing: float, target: Any) -> None:
    """Link to `target` the socket that is linked to an input, or give it the same value."""
    value: Any = missing if socket is None else socket.default_value
    if socket is not None and socket.is_linked:
        tree.links.new(_linked(socket), target)
    elif hasattr(target.default_value, "__len__"):
        target.default_value = tuple(value) if hasattr(value, "__len__") else (value, value, value, 1.0)
    else:
        target.default_value = value


def _linked(socket: Any) -> Any:
    return socket.links[0].from_socket if socket.is_linked else None
