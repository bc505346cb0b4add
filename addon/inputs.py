"""The inputs of a Geometry Nodes modifier, read and set the same way in Blender 4.2 and 5.2.

A parameter is a dictionary of the API: its `input` is the identifier of an input, its `component` an axis of a vector.
Angles are degrees in the API and radians in Blender.
"""

from __future__ import annotations

import math
from typing import Any

TYPES = {bool: ("Bool",), int: ("Int",), str: ("Menu",)}
VECTORS = ("Vector", "Rotation")
REALS = ("Float", "Int", *VECTORS)
AXES = "xyz"


def has_all(modifier: Any, parameters: list[dict]) -> bool:
    """Whether a modifier has an input of the right type for each parameter."""
    if modifier.type != "NODES" or not modifier.node_group or not parameters:
        return False
    found = _sockets(modifier)
    return all(p["input"] in found and _fits(modifier, found[p["input"]], p) for p in parameters)


def read(modifier: Any, parameters: list[dict]) -> dict[str, Any]:
    """The values of the parameters, in their own units; without parameters no modifier is needed."""
    found = _sockets(modifier) if parameters else {}
    return {p["name"]: _read_one(modifier, found[p["input"]], p) for p in parameters}


def write(modifier: Any, parameters: list[dict], values: dict[str, Any]) -> None:
    """Set the inputs of all parameters, and let Blender evaluate the object anew; KeyError for a missing value."""
    found = _sockets(modifier)
    for p in parameters:
        _write_one(modifier, found[p["input"]], p, values[p["name"]])
    modifier.id_data.update_tag()


def _sockets(modifier: Any) -> dict[str, Any]:
    items = modifier.node_group.interface.items_tree
    return {item.identifier: item for item in items if item.item_type == "SOCKET" and item.in_out == "INPUT"}


def _type(socket: Any) -> str:
    return socket.socket_type.removeprefix("NodeSocket")


def _fits(modifier: Any, socket: Any, p: dict) -> bool:
    options = [option["value"] for option in p["options"]]
    if _type(socket) not in (TYPES[type(options[0])] if options else REALS):
        return False
    if (_type(socket) in VECTORS) != bool(p["component"]):
        return False
    return _type(socket) != "Menu" or set(options) <= set(_menu(modifier, p["input"]))


def _read_one(modifier: Any, socket: Any, p: dict) -> Any:
    value = _get(modifier, p["input"])
    if p["component"]:
        value = value[AXES.index(p["component"])]
    if _type(socket) == "Menu":
        return value if isinstance(value, str) else _name(_menu(modifier, p["input"]), value)
    if isinstance(value, (bool, int)):
        return bool(value) if _type(socket) == "Bool" else value
    # Blender's single precision has seven digits. More of them would lie outside of the ranges by rounding.
    return float(f"{value * _scale(socket):.6g}")


def _write_one(modifier: Any, socket: Any, p: dict, value: Any) -> None:
    kind = _type(socket)
    if kind == "Menu":
        return _set(modifier, p["input"], _menu(modifier, p["input"])[value] if _newer(modifier) is None else value)
    if kind in ("Bool", "Int"):
        return _set(modifier, p["input"], bool(value) if kind == "Bool" else round(value))
    number = float(value) / _scale(socket)
    if p["component"]:
        vector = list(_get(modifier, p["input"]))
        vector[AXES.index(p["component"])] = number
        return _set(modifier, p["input"], vector)
    return _set(modifier, p["input"], number)


def _scale(socket: Any) -> float:
    """Degrees in a radian for an angle, and 1 for anything else."""
    is_angle = _type(socket) == "Rotation" or getattr(socket, "subtype", "") in ("ANGLE", "EULER")
    return math.degrees(1) if is_angle else 1.0


def _newer(modifier: Any) -> Any:
    """The inputs as Blender 5.2 has them; None in older ones, which store custom properties."""
    return getattr(getattr(modifier, "properties", None), "inputs", None)


def slider(modifier: Any, identifier: str) -> tuple[Any, str]:
    """What a panel draws as the slider of an input: who has the property, and its name."""
    newer = _newer(modifier)
    return (modifier, f'["{identifier}"]') if newer is None else (getattr(newer, identifier), "value")


def _get(modifier: Any, identifier: str) -> Any:
    newer = _newer(modifier)
    return modifier[identifier] if newer is None else getattr(newer, identifier).value


def _set(modifier: Any, identifier: str, value: Any) -> None:
    if (newer := _newer(modifier)) is not None:
        entry = getattr(newer, identifier)
        entry.type, entry.value = "VALUE", value
        return
    if f"{identifier}_use_attribute" in modifier:
        modifier[f"{identifier}_use_attribute"] = False
    modifier[identifier] = value


def _menu(modifier: Any, identifier: str) -> dict[str, int]:
    """The numbers of a menu's items by their names."""
    if (newer := _newer(modifier)) is not None:
        items = getattr(newer, identifier).bl_rna.properties["value"].enum_items
        return {item.name: item.value for item in items}
    shown = modifier.id_properties_ui(identifier).as_dict()
    return {name: number for _, name, _, _, number in shown.get("items", ())}


def _name(menu: dict[str, int], number: int) -> str:
    return next((name for name, other in menu.items() if other == number), "")
