"""Infinigen's dandelion with the paper's 15 parameters.

A thin adapter: Infinigen makes its node graph once in each process, and a build sets values on the nodes of the graph.
All seeds have the same shape, so that the graph places small frames of axes in place of seeds, and NumPy puts a copy of
the seed into each frame. The points are the same, and Blender does not handle millions of faces.

Differences from Infinigen:
- Seeds are missing where both their row and their column lie between two bounds. The factory computes both bounds of
  the columns from `col_less_than`, so that nothing lies between them and all four parameters have no effect. Here each
  parameter is the bound that its name states. If the lower bound is above the upper one, the seeds outside are missing.
- Infinigen rounds the bounds down to whole rows and columns. Here they are not rounded, so that smaller changes have an
  effect.
- Blender's random node decides from the place alone which other seeds are missing. Therefore a mirrored head is not a
  head of this generator.
- `transform_scale` is negative, as in Infinigen: heads are point reflections, and faces are turned to look outwards.
- The middle of the range replaces each draw of the factory: a full head has three quarters of the seeds, the core has a
  radius of 35 mm times the scale and 0.65 of it as its height, and all seeds are straight and have one shape.
- The thorns of a seed, about a thousand with a length of half a millimetre, have 4 sides instead of 32, and its round
  top has 12 instead of 64. A head then has up to 7 million triangles instead of 27 million.

Sources: Infinigen (Raistrick et al. 2023) for the factory, DI-PCG's published parameters for list and ranges.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator
from typing import Any

import numpy as np

from dipcg.blender.infinigen import (
    find_node,
    graph_object,
    graph_of,
    import_infinigen,
    middle,
    read_socket,
    replaced,
    set_node,
    silence,
)
from dipcg.camera import ViewRange
from dipcg.mesh import Mesh, Solid, join, numbered
from dipcg.mesh.simplify import simplify
from dipcg.space import Choice, ParameterSpace, Params, Real

_SPARSE = {"flower_mode": ("sparse_flower",)}

space = ParameterSpace(
    Choice(
        "flower_mode",
        ("full_flower", "no_flower", "sparse_flower"),
        doc="amount of seeds",
        group="seed",
        labels=("full", "none", "sparse"),
    ),
    Real("random_dropout", 0.2, 0.6, unit="share", doc="seeds that are present", group="seed", when=_SPARSE),
    Real("row_less_than", 0.0, 1.0, unit="of rings", doc="highest missing row", group="seed", when=_SPARSE),
    Real("col_less_than", 0.0, 1.0, unit="of segments", doc="highest missing column", group="seed", when=_SPARSE),
    Real("row_great_than", 0.0, 1.0, unit="of rings", doc="lowest missing row", group="seed", when=_SPARSE),
    Real("col_great_than", 0.0, 1.0, unit="of segments", doc="lowest missing column", group="seed", when=_SPARSE),
    Real("bezier_middle_x", -0.6, 0.6, unit="m", doc="middle of the stem's curve, along x", group="stem"),
    Real("bezier_middle_y", -0.6, 0.6, unit="m", doc="middle of the stem's curve, along y", group="stem"),
    Real("bezier_end_x", -0.6, 0.6, unit="m", doc="end of the stem, along x", group="stem"),
    Real("bezier_end_y", -0.6, 0.6, unit="m", doc="end of the stem, along y", group="stem"),
    Choice("flower_num_core_segments", (8, 15, 20, 25), doc="columns of seeds", group="core"),
    Choice("flower_num_core_rings", (8, 15, 20), doc="rows of seeds from pole to pole", group="core"),
    Real("transform_scale", -0.7, -0.1, unit="×", doc="size of the head, as a negative number", group="core"),
    Real("stem_map_range", 0.1, 0.6, unit="of stem_radius", doc="radius at the head; 0.4 at the foot", group="stem"),
    Real("stem_radius", 0.01, 0.03, unit="m", doc="of the stem", group="stem"),
)
# What people read for the names of Infinigen.
labels = {
    "flower_mode": "amount", "random_dropout": "seeds present", "row_less_than": "highest missing row",
    "col_less_than": "highest missing column", "row_great_than": "lowest missing row",
    "col_great_than": "lowest missing column", "bezier_middle_x": "middle, left to right",
    "bezier_middle_y": "middle, front to back", "bezier_end_x": "end, left to right",
    "bezier_end_y": "end, front to back", "flower_num_core_segments": "columns of seeds",
    "flower_num_core_rings": "rows of seeds", "transform_scale": "size of the head",
    "stem_map_range": "thickness at the head", "stem_radius": "thickness",
}  # fmt: skip
# A turned stem is a stem with other parameters, so the range is narrow; the paper has the azimuth and the elevation 0.
views = ViewRange(azimuth_deg=(-30, 30), elevation_deg=(-15, 40))
mirrors = None
needs = ("infinigen", "bpy")
# A head has up to 358 seeds of 64 triangles, and simplifying them further would remove its fluff.
light_faces = 25_000

_MODULE = "infinigen.assets.objects.grassland.dandelion"
# The number of filaments of a seed.
_FILAMENTS = 40
# The share of seeds that a full head has: the middle of the range of the factory.
_FULL_HEAD = 0.75
_SHARES = ("random_dropout", "row_less_than", "col_less_than", "row_great_than", "col_great_than")


@functools.cache
def prepare() -> Any:
    """Import Infinigen; make the node graph that all builds use, as an object, and a full and a light seed."""
    module = import_infinigen(_MODULE)
    with silence(), _middle_draws(module):
        make = module.node_utils.to_nodegroup("dandelion")(module.geometry_dandelion_nodes)
        graph = make(**dict.fromkeys(_SHARES, 0.0))
    obj, seed = graph_object(graph), graph_object(find_node(graph, "nodegroup_petal_stem").node_tree)
    _place_axes(obj)
    return obj, _full_seed(seed), _light_seed(seed)


@contextlib.contextmanager
def _middle_draws(module: Any) -> Iterator[None]:
    def mean(mean: float, deviation: float) -> float:
        return mean

    numbers = replaced(module, uniform=middle, normal=mean, randint=lambda low, high: low)
    curves = replaced(module.np.random, normal=mean)
    materials = replaced(module.surface, shaderfunc_to_material=lambda *args: None)
    with numbers, curves, materials:
        yield


def build(params: Params) -> Mesh:
    """The full mesh of the dandelion."""
    return join(list(_pieces(params, light=False)))


def build_light(params: Params) -> Mesh:
    """A coarser mesh: the stem has 8 sides instead of 32, and a seed has 64 triangles."""
    return join(list(_pieces(params, light=True)))


def _pieces(p: Any, light: bool) -> Iterator[Solid]:
    obj, *seeds = prepare()
    graph = graph_of(obj)
    _set_stem(graph, p, 8 if light else 32)
    _set_head(graph, p)
    obj.update_tag()
    yield read_socket("stem", obj, find_node(graph, "nodegroup_stem_geometry").outputs[0])
    # The core has faces, and the frames are the vertices without a face, four for each.
    _, vertices, faces, quads, _ = read_socket("head", obj, find_node(graph, "nodegroup_flower_on_stem").outputs[0])
    in_core = np.zeros(len(vertices), bool)
    in_core[faces] = True
    frames = vertices[~in_core].reshape(-1, 4, 3)
    yield Solid("core", vertices[in_core], _facing_outwards(vertices[in_core], (np.cumsum(in_core) - 1)[faces]), quads)
    if len(frames):
        yield _instances(seeds[light], frames)


def _facing_outwards(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces of a closed surface, all reversed if the enclosed volume is negative."""
    a, b, c = (vertices[faces[:, i]] - vertices[0] for i in range(3))
    return faces if np.sum(a * np.cross(b, c)) > 0 else faces[:, ::-1]


# The head: a frame of axes in place of each seed


def _place_axes(obj: Any) -> None:
    """Make the graph place axes instead of seeds; axes are a vertex at the origin with edges to three others."""
    graph = graph_of(obj)
    obj.data.from_pydata(np.concatenate([np.zeros((1, 3)), np.eye(3)]), [(0, 1), (0, 2), (0, 3)], [])
    graph.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group_input = graph.nodes.new("NodeGroupInput").outputs[0]
    graph.links.new(group_input, find_node(graph, "nodegroup_flower_geometry").inputs["Instance"])


def _instances(seed: Solid, frames: np.ndarray) -> Solid:
    """Copies of a seed, one in each frame `4 3`: the images of its origin and of its three unit vectors."""
    origins, axes = frames[:, :1], frames[:, 1:] - frames[:, :1]
    turned = seed.faces if np.linalg.det(axes[0]) > 0 else seed.faces[:, ::-1]
    number = np.arange(len(frames), dtype=np.int32)
    faces = (number[:, None, None] * np.int32(len(seed.vertices)) + turned).reshape(-1, 3)
    quads = None if seed.quads is None else numbered([seed.quads] * len(frames), [len(turned)] * len(frames))
    vertices = (seed.vertices @ axes + origins).reshape(-1, 3)
    return Solid(seed.part, vertices, faces, quads, np.repeat(number, len(turned)))


def _set_stem(graph: Any, p: Any, sides: int) -> None:
    middle, end = ((p[f"bezier_{at}_x"], p[f"bezier_{at}_y"]) for at in ("middle", "end"))
    set_node(find_node(graph, "CURVE_PRIMITIVE_QUADRATIC_BEZIER"), {"Middle": (*middle, 0.5), "End": (*end, 1.0)})
    stem = find_node(graph, "nodegroup_stem_geometry").node_tree
    _set_value(stem.nodes["stem_radius"], p["stem_radius"])
    _set_value(find_node(stem, "MAP_RANGE").inputs["To Max"].links[0].from_node, p["stem_map_range"])
    set_node(find_node(stem, "CURVE_PRIMITIVE_CIRCLE"), {"Resolution": sides})


def _set_head(graph: Any, p: Any) -> None:
    _set_value(find_node(graph, "VALUE"), p["transform_scale"])
    head = find_node(graph, "nodegroup_flower_geometry").node_tree
    rings, segments = p["flower_num_core_rings"], p["flower_num_core_segments"]
    head.nodes["num_core_rings"].integer = rings
    head.nodes["num_core_segments"].integer = segments
    chosen = find_node(head, "nodegroup_petal_selection").node_tree
    share = {"full_flower": _FULL_HEAD, "no_flower": 0.0, "sparse_flower": p["random_dropout"]}[p["flower_mode"]]
    find_node(chosen, "MATH").inputs[0].default_value = share
    sparse = p["flower_mode"] == "sparse_flower"
    for operation, name, count in (("DIVIDE", "row", sparse * rings), ("MODULO", "col", sparse * segments)):
        _set_gap(chosen, operation, count * p[f"{name}_less_than"], count * p[f"{name}_great_than"])


def _set_gap(chosen: Any, operation: str, below: float, above: float) -> None:
    """Set the bounds of the missing rows, which are quotients in the graph, or columns, which are remainders."""
    number = next(node for node in chosen.nodes if node.type == "MATH" and node.operation == operation)
    for comparison in (link.to_node for link in number.outputs[0].links):
        comparison.inputs[1].default_value = below if comparison.operation == "LESS_THAN" else above
        comparison.outputs[0].links[0].to_node.operation = "AND" if below >= above else "OR"


def _set_value(node: Any, value: float) -> None:
    node.outputs[0].default_value = value


# The seed, the same for all heads, with its foot at the origin


def _full_seed(seed: Any) -> Solid:
    """Infinigen's seed, whose thorns and round top have fewer sides."""
    tree = graph_of(seed)
    set_node(find_node(_tree(tree, "end_geometry"), "MESH_PRIMITIVE_CONE"), {"Vertices": 4})
    set_node(find_node(_tree(tree, "head_geometry"), "MESH_PRIMITIVE_UV_SPHERE"), {"Segments": 12, "Rings": 6})
    return read_socket("seed", seed, find_node(tree, "JOIN_GEOMETRY").outputs[0])


def _light_seed(seed: Any) -> Solid:
    """A seed with a stalk of three sides, a body of four sides without thorns, and a blade for each filament."""
    tree = graph_of(seed)
    set_node(find_node(_tree(tree, "geometry"), "CURVE_PRIMITIVE_QUADRATIC_BEZIER"), {"Resolution": 3})
    set_node(find_node(_tree(tree, "geometry"), "CURVE_PRIMITIVE_CIRCLE"), {"Resolution": 3})
    set_node(find_node(_tree(tree, "end_geometry"), "MESH_PRIMITIVE_UV_SPHERE"), {"Segments": 4, "Rings": 3})
    set_node(find_node(_tree(tree, "end_geometry"), "INSTANCE_ON_POINTS"), {"Selection": False})
    stalk, body, filaments = (_read_part(seed, name) for name in ("geometry", "end_geometry", "branch_geometry"))
    straight = simplify(join([stalk]), faces=8)
    tuft = _blades(filaments[1].reshape(_FILAMENTS, -1, 4, 3))
    light = join([("seed", straight.vertices, straight.faces), body, ("seed", *tuft)])
    return Solid("seed", light.vertices, light.faces)


def _blades(tubes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each tube, given as rings of corners, one triangle along its best straight line with as large a silhouette.

    By Cauchy's formula equal surfaces have equal mean silhouettes. Both sides of a triangle count, so that its base is
    as wide as the circumference of the tube. Horizontal and vertical blades alternate, and so do blades that point
    outwards and inwards, so that the tuft has no gaps from any side.
    """
    lines = tubes.mean(2)
    slope, start = np.polyfit(np.linspace(0, 1, lines.shape[1]), lines.swapaxes(0, 1).reshape(lines.shape[1], -1), 1)
    circumference = np.linalg.norm(tubes - np.roll(tubes, 1, axis=2), axis=3).sum(2).mean()
    base, along = start.reshape(-1, 3), slope.reshape(-1, 3)
    number = np.arange(len(lines))[:, None]
    horizontal = np.cross(along, [0, 0, 1])
    across = np.where(number % 2 == 0, horizontal, np.cross(along, horizontal))
    across *= circumference / 2 / np.linalg.norm(across, axis=1, keepdims=True)
    base, along = np.where(number // 2 % 2 == 0, (base, along), (base + along, -along))
    corners = np.stack([base - across, base + across, base + along], axis=1)
    return corners.reshape(-1, 3), np.arange(3 * len(lines)).reshape(-1, 3)


def _read_part(seed: Any, name: str) -> Solid:
    return read_socket("seed", seed, find_node(graph_of(seed), f"nodegroup_petal_stem_{name}").outputs[0])


def _tree(graph: Any, name: str) -> Any:
    return find_node(graph, f"nodegroup_petal_stem_{name}").node_tree
