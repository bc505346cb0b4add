"""The inputs of a modifier as Blender 5.2 has them: a stand-in with its attributes, since its module is not here."""

import importlib.util
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

FILE = Path(__file__).parents[2] / "addon" / "inputs.py"
SUBTYPES = {"Socket_1": "NONE", "Socket_2": "ANGLE", "Socket_3": "NONE", "Socket_4": "NONE"}
TYPES = {"Socket_1": "Vector", "Socket_2": "Float", "Socket_3": "Menu", "Socket_4": "Int"}


@pytest.fixture
def inputs() -> ModuleType:
    spec = importlib.util.spec_from_file_location("inputs", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Newer(SimpleNamespace):
    """A modifier of Blender 5.2: its inputs are attributes and no custom properties."""

    def __init__(self) -> None:
        items = [SimpleNamespace(name=name, value=number) for number, name in enumerate(["Cone", "Dome"])]
        menu = SimpleNamespace(properties={"value": SimpleNamespace(enum_items=items)})
        values = {"Socket_1": [1.0, 2.0, 3.0], "Socket_2": 0.0, "Socket_3": "Cone", "Socket_4": 3}
        given = {key: SimpleNamespace(type="ATTRIBUTE", value=value, bl_rna=menu) for key, value in values.items()}
        sockets = [SimpleNamespace(identifier=key, subtype=subtype) for key, subtype in SUBTYPES.items()]
        for socket in sockets:
            socket.item_type, socket.in_out = "SOCKET", "INPUT"
            socket.socket_type = f"NodeSocket{TYPES[socket.identifier]}"
        tree = SimpleNamespace(interface=SimpleNamespace(items_tree=sockets))
        properties = SimpleNamespace(inputs=SimpleNamespace(**given))
        owner = SimpleNamespace(update_tag=lambda: None)
        super().__init__(type="NODES", node_group=tree, properties=properties, id_data=owner)


def parameter(name: str, number: int, *options: object, component: str = "") -> dict:
    listed = [{"value": option, "label": ""} for option in options]
    return {"name": name, "input": f"Socket_{number}", "component": component, "options": listed}


PARAMETERS = [parameter("y", 1, component="y"), parameter("turn", 2), parameter("shade", 3, "Cone", "Dome")]
PARAMETERS += [parameter("rings", 4, 2, 3)]
VALUES = {"y": 0.25, "turn": 90.0, "shade": "Dome", "rings": 2}


def test_what_is_written_is_read(inputs) -> None:
    modifier = Newer()
    assert inputs.has_all(modifier, PARAMETERS)
    inputs.write(modifier, PARAMETERS, VALUES)
    stored = {key: entry.value for key, entry in vars(modifier.properties.inputs).items()}
    assert stored == {
        "Socket_1": [1.0, 0.25, 3.0],
        "Socket_2": pytest.approx(1.5707963),
        "Socket_3": "Dome",
        "Socket_4": 2,
    }
    assert {entry.type for entry in vars(modifier.properties.inputs).values()} == {"VALUE"}
    assert inputs.read(modifier, PARAMETERS) == VALUES


@pytest.mark.parametrize(
    "other",
    [parameter("y", 1), parameter("turn", 2, False, True), parameter("shade", 3, "Cone", "Bell"), parameter("new", 9)],
    ids=["a vector without an axis", "another type", "another menu", "no such input"],
)
def test_a_modifier_with_other_inputs_is_not_taken(inputs, other) -> None:
    assert not inputs.has_all(Newer(), [*PARAMETERS, other])
