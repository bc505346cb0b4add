"""The inputs of a node group, read and set the same way in every Blender from 3.4 to 5.3."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from dipcg.space import Value

KINDS = {"Float": "real", "Int": "integer", "Bool": "boolean", "Menu": "menu", "Vector": "vector", "Rotation": "vector"}
# The identifier of an input, a component, which is "" unless it is a vector, and a value.
Setting = tuple[str, str, Value]
# A Blender file, an object in it, a modifier, and the names of the groups that lead to its inputs.
Place = tuple[str, str, str, tuple[str, ...]]
# Limits of this or more count as none; Blender's own defaults are so large.
ENDLESS = 1e4


@dataclass(frozen=True)
class Socket:
    """The declaration of an input; limits are None where there are none."""

    identifier: str
    name: str
    type: str
    subtype: str
    low: float | None
    high: float | None
    doc: str
    panel: str
    hidden: bool

    @property
    def kind(self) -> str:
        """What a parameter of this input would be, or an empty text for an input that cannot be one."""
        return KINDS.get(self.type, "")


def sockets(tree: Any) -> list[Socket]:
    """The inputs of a node group, without its geometry."""
    # Blender 4.0 replaced the list of inputs by an interface with panels.
    items = tree.interface.items_tree if hasattr(tree, "interface") else tree.inputs
    found = [item for item in items if getattr(item, "item_type", "SOCKET") == "SOCKET"]
    inputs = [_socket(item) for item in found if getattr(item, "in_out", "INPUT") == "INPUT"]
    return [socket for socket in inputs if socket.type != "Geometry"]


def add_geometry_sockets(tree: Any) -> None:
    """Give a new node group an input and an output for geometry."""
    for direction, older in (("INPUT", "inputs"), ("OUTPUT", "outputs")):
        if hasattr(tree, "interface"):
            tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
        else:
            getattr(tree, older).new("NodeSocketGeometry", "Geometry")


@dataclass(frozen=True)
class ModifierInputs:
    """The values of the inputs of a Geometry Nodes modifier."""

    modifier: Any

    @property
    def tree(self) -> Any:
        return self.modifier.node_group

    @property
    def newer(self) -> Any:
        """The inputs as Blender 5.1 and later have them; None in older ones, which store custom properties."""
        return getattr(getattr(self.modifier, "properties", None), "inputs", None)

    def is_free(self, socket: Socket) -> bool:
        """Whether the value of the input decides, and not a node that is linked to it."""
        return not socket.hidden

    def read(self, socket: Socket) -> Any:
        if self.newer is not None:
            return getattr(self.newer, socket.identifier).value
        value = self.modifier[socket.identifier]
        if socket.type != "Menu":
            return value
        return next((name for name, number in self._menu(socket).items() if number == value), "")

    def write(self, socket: Socket, value: Any) -> None:
        if self.newer is not None:
            entry = getattr(self.newer, socket.identifier)
            entry.type, entry.value = "VALUE", value
            return
        if f"{socket.identifier}_use_attribute" in self.modifier:
            self.modifier[f"{socket.identifier}_use_attribute"] = False
        self.modifier[socket.identifier] = self._menu(socket)[value] if socket.type == "Menu" else value

    def options(self, socket: Socket) -> list[str]:
        """The names of the items of a menu."""
        if self.newer is None:
            return list(self._menu(socket))
        return [item.name for item in getattr(self.newer, socket.identifier).bl_rna.properties["value"].enum_items]

    def _menu(self, socket: Socket) -> dict[str, int]:
        shown = self.modifier.id_properties_ui(socket.identifier).as_dict()
        return {name: number for _, name, _, _, number in shown.get("items", ())}


@dataclass(frozen=True)
class NodeInputs:
    """The values of the inputs of a group within a node graph."""

    node: Any

    @property
    def tree(self) -> Any:
        return self.node.node_tree

    def is_free(self, socket: Socket) -> bool:
        """Whether the value of the input decides, and not a node that is linked to it."""
        return not self._input(socket).is_linked

    def read(self, socket: Socket) -> Any:
        return self._input(socket).default_value

    def write(self, socket: Socket, value: Any) -> None:
        self._input(socket).default_value = value

    def options(self, socket: Socket) -> list[str]:
        """The names of the items of a menu, which Blender tells only in its answer to a name that is not one."""
        try:
            self.write(socket, "\0")
        except TypeError as error:
            listed = re.search(r"not found in (\(.*\))", str(error))
            return [str(name) for name in ast.literal_eval(listed[1])] if listed else []
        return []

    def _input(self, socket: Socket) -> Any:
        return next(one for one in self.node.inputs if one.identifier == socket.identifier)


Inputs = ModifierInputs | NodeInputs


def usable(inputs: Inputs) -> list[Socket]:
    """The inputs that can be parameters."""
    free = [socket for socket in sockets(inputs.tree) if socket.kind and inputs.is_free(socket)]
    return [socket for socket in free if socket.kind != "menu" or len(inputs.options(socket)) > 1]


def inner_groups(tree: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The groups in a node graph and in those groups, outer ones first, each with the names that lead to it."""
    groups = [((node.name,), node) for node in tree.nodes if node.type == "GROUP" and node.node_tree]
    yield from groups
    for path, node in groups:
        for below, inner in inner_groups(node.node_tree):
            yield (*path, *below), inner


def _socket(item: Any) -> Socket:
    # Blender 3 writes the subtype into the name of the type, as in NodeSocketFloatDistance.
    name = getattr(item, "socket_type", "") or item.bl_socket_idname
    parsed = re.match(r"NodeSocket([A-Z][a-z]+)(\w*)", name)
    kind, older = (parsed[1], re.sub(r"(?<!^)([A-Z])", r"_\1", parsed[2]).upper()) if parsed else (name, "")
    subtype = "EULER" if kind == "Rotation" else getattr(item, "subtype", older) or "NONE"
    low, high = (_limit(getattr(item, key, None)) for key in ("min_value", "max_value"))
    panel = getattr(getattr(item, "parent", None), "name", "")
    hidden = getattr(item, "hide_in_modifier", False)
    return Socket(item.identifier, item.name, kind, subtype, low, high, item.description, panel, hidden)


def _limit(value: float | int | None) -> float | None:
    return None if value is None or abs(value) >= ENDLESS else float(value)
