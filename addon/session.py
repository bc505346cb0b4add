"""What the panel shows and the operators share: settings in Blender, and answers of the server in memory."""

import base64
import sys
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import bpy
import bpy.utils.previews

from . import inputs
from .server import Estimated, Task

# Blender keeps no reference to the items of a menu, so that they must live here.
_items: list[tuple[str, str, str]] = []
_generators: dict[str, dict[str, Any]] = {}
_previews: Any = None
estimated: Estimated | None = None
# The names of the object and of its modifier that the estimate is for; None for a generator that ships.
target: tuple[str, str] | None = None
task: Task | None = None
# The training of the active generator, and the thread that follows it.
training: dict[str, Any] | None = None
watching: Task | None = None
# The newest Blender whose files every server reads.
SERVERS = (4, 2)


class Lock(bpy.types.PropertyGroup):
    """Whether a parameter keeps its value in the next estimate."""

    held: bpy.props.BoolProperty(name="Lock", description="Keep this value in the next estimate")


class Range(bpy.types.PropertyGroup):
    """The range of a parameter that is learned; `proposed` is as the server has it."""

    is_number: bpy.props.BoolProperty()
    used: bpy.props.BoolProperty(name="Learn", description="Learn this input; otherwise it stays as in the file")
    low: bpy.props.FloatProperty(name="Lowest", precision=4)
    high: bpy.props.FloatProperty(name="Highest", precision=4)
    proposed: bpy.props.FloatVectorProperty(size=2)
    is_edited: bpy.props.BoolProperty()
    why: bpy.props.StringProperty()

    @property
    def differs(self) -> bool:
        """Whether it was edited since the server last said what it has."""
        return (self.low, self.high) != tuple(self.proposed)


class Settings(bpy.types.PropertyGroup):
    """What the user chooses, and a sentence for the user."""

    picture: bpy.props.StringProperty(name="Picture", description="The picture to estimate from", subtype="FILE_PATH")
    generator: bpy.props.EnumProperty(
        name="Generator",
        description="What makes the thing in the picture",
        items=lambda self, context: _items,
        update=lambda self, context: self.fill_locks(),
    )
    locks: bpy.props.CollectionProperty(type=Lock)
    status: bpy.props.StringProperty()
    ranges: bpy.props.CollectionProperty(type=Range)
    shapes: bpy.props.IntProperty(name="Shapes", description="How many are built to learn from", default=3000, min=40)
    minutes: bpy.props.IntProperty(name="Minutes", description="How long is trained", default=30, min=1)
    progress: bpy.props.StringProperty()

    def edited_ranges(self) -> dict[str, list[float]]:
        """The ranges that differ from the proposed ones, by parameter."""
        used = [one for one in self.ranges if one.is_number and one.used]
        return {one.name: [_short(one.low), _short(one.high)] for one in used if one.is_edited or one.differs}

    def held(self) -> list[str]:
        """The parameters that stay as in the file."""
        return [one.name for one in self.ranges if not one.used]

    def fill_locks(self) -> None:
        self.locks.clear()
        for parameter in chosen(self)["parameters"]:
            self.locks.add().name = parameter["name"]


class Preferences(bpy.types.AddonPreferences):
    """The server that is asked."""

    bl_idname = __package__
    address: bpy.props.StringProperty(
        name="Server", description="Where `dipcg serve` runs on this machine", default="http://127.0.0.1:7860"
    )

    program: bpy.props.StringProperty(
        name="Program",
        description="The program dipcg, such as /home/me/dipcg/.venv/bin/dipcg, to start the server when none runs",
        subtype="FILE_PATH",
    )
    folder: bpy.props.StringProperty(
        name="Generators",
        description="Where a server that is started keeps the generators that it learns",
        subtype="DIR_PATH",
        default=str(Path.home() / "dipcg-generators"),
    )

    def draw(self, context: bpy.types.Context) -> None:
        for name in ("address", "program", "folder"):
            self.layout.prop(self, name)


CLASSES = (Lock, Range, Settings, Preferences)


def address(context: bpy.types.Context) -> str:
    """The address of the server."""
    return context.preferences.addons[__package__].preferences.address


def _this_blender() -> list[str]:
    """The program of this Blender, by which the server reads files that are too new for its own."""
    # A module of Python has no program of its own.
    return ["--blender", bpy.app.binary_path or sys.executable] if bpy.app.version[:2] > SERVERS else []


def command(context: bpy.types.Context) -> list[str]:
    """What starts the server, from the preferences; empty without a program."""
    chosen = context.preferences.addons[__package__].preferences
    if not chosen.program:
        return []
    folder, port = bpy.path.abspath(chosen.folder), str(urlsplit(chosen.address).port or 80)
    return [bpy.path.abspath(chosen.program), "serve", "--port", port, "--learn", folder, *_this_blender()]


def take_training(settings: Settings, found: dict[str, Any] | None) -> None:
    """Show a training and its ranges."""
    global training
    training = found
    settings.ranges.clear()
    for p in found["parameters"] if found else ():
        one = settings.ranges.add()
        one.name, one.used, one.why, one.is_edited = p["name"], not p["held"], p["why"], p["edited"]
        one.is_number = p["low"] is not None
        if one.is_number:
            one.low, one.high = p["low"], p["high"]
            one.proposed = (one.low, one.high)


def training_of(obj: Any, trainings: list[dict[str, Any]]) -> dict[str, Any] | None:
    """The newest training of an object."""
    return next((one for one in reversed(trainings) if obj and one["object"] == obj.name and one["parameters"]), None)


def serve(settings: Settings, obj: Any, generators: list[dict[str, Any]]) -> None:
    """Take the generators of a server, and choose the one that the active object's modifier belongs to, if any."""
    _generators.clear()
    _generators.update({generator["name"]: generator for generator in generators})
    _items[:] = [(g["name"], g["label"], g["doc"]) for g in generators]
    fitting = [name for name in _generators if find_modifier(obj, _generators[name])]
    if _generators:
        settings.generator = (fitting or list(_generators))[0]


def is_connected() -> bool:
    """Whether the generators of a server are known."""
    return bool(_generators)


def chosen(settings: Settings) -> dict[str, Any]:
    """The generator of the menu."""
    return _generators[settings.generator]


def find_modifier(obj: Any, generator: dict[str, Any]) -> Any:
    """The modifier of an object whose inputs a generator sets, the active one first; None without such a modifier."""
    found = sorted(obj.modifiers, key=lambda modifier: not modifier.is_active) if obj else []
    return next((modifier for modifier in found if inputs.has_all(modifier, generator["parameters"])), None)


def candidate(number: int) -> dict[str, Any]:
    """A candidate of the estimate; raises ValueError with a sentence."""
    found = estimated.result["candidates"] if estimated else []
    if not 0 <= number < len(found):
        raise ValueError(f"There are {len(found)} candidates, numbered from 0, got {number}; estimate first.")
    return found[number]


def estimated_generator() -> dict[str, Any]:
    """The generator of the estimate."""
    return _generators[estimated.result["generator"]]


def find_target(context: bpy.types.Context) -> tuple[Any, Any]:
    """The object and the modifier that the estimate is for; the modifier is None when it is gone or another."""
    obj = context.scene.objects.get(target[0])
    modifier = obj.modifiers.get(target[1]) if obj else None
    return obj, modifier if modifier and inputs.has_all(modifier, estimated_generator()["parameters"]) else None


def keep(found: Estimated, where: tuple[str, str] | None) -> None:
    """Take an estimate, and load the pictures of its candidates."""
    global estimated, target, _previews
    close()
    estimated, target, _previews = found, where, bpy.utils.previews.new()
    for number, candidate in enumerate(found.result["candidates"]):
        if candidate["thumbnail"]:
            path = temporary(f"candidate{number}.webp", base64.b64decode(candidate["thumbnail"].partition(",")[2]))
            _previews.load(str(number), path, "IMAGE")


def icon(number: int) -> int:
    """The picture of a candidate for a panel; 0 without one."""
    return _previews[str(number)].icon_id if _previews and str(number) in _previews else 0


def spread(parameter: dict[str, Any]) -> str:
    """How far the candidates differ in a parameter, for a panel."""
    found = estimated.result.get("spread", {}).get(parameter["name"]) if estimated else None
    return "" if found is None else f"± {found:.2g} {parameter['unit']}"


def temporary(name: str, content: bytes) -> str:
    """Write a file that Blender deletes when it ends, and return its path."""
    path = Path(bpy.app.tempdir) / f"dipcg_{name}"
    path.write_bytes(content)
    return str(path)


def _short(number: float) -> float:
    """A number of Blender's single precision without the digits that it does not have."""
    return float(f"{number:.6g}")


def close() -> None:
    """Forget the estimate, and stop what runs."""
    global estimated, target, _previews
    estimated = target = None
    if task:
        task.stopped.set()
    if _previews:
        bpy.utils.previews.remove(_previews)
        _previews = None
