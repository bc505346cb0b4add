"""Blender with the add-on, in a process of its own: `python in_blender.py CASE JSON` prints what it finds as JSON."""

import json
import os
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import bpy

LAMP = Path(__file__).parents[2] / "examples" / "lamp.blend"
MODULE = "bl_ext.user_default.dipcg"


def opened(address: str, blend: str = str(LAMP)) -> None:
    """Open a file with the add-on switched on."""
    bpy.ops.wm.open_mainfile(filepath=blend)
    bpy.context.view_layer.objects.active = bpy.data.objects.get("Lamp")
    bpy.ops.preferences.addon_enable(module=MODULE)
    bpy.context.preferences.addons[MODULE].preferences.address = address


def settings():
    return bpy.context.window_manager.dipcg


def said(operator, **options) -> str:
    """The sentence with which an operator fails."""
    try:
        operator(**options)
    except RuntimeError as error:
        return str(error).strip()
    return ""


def values() -> dict:
    """All inputs of the lamp's modifier, as Blender stores them; of menus the names of their items."""
    modifier = bpy.data.objects["Lamp"].modifiers[0]
    plain = {key: list(value) if hasattr(value, "to_list") else value for key, value in modifier.items()}
    for key in [key for key, value in plain.items() if type(value) is int]:
        items = modifier.id_properties_ui(key).as_dict().get("items", ())
        plain[key] = next((item[1] for item in items if item[4] == plain[key]), plain[key])
    return {key: value for key, value in plain.items() if isinstance(value, bool | int | float | str | list)}


def bounds(name: str) -> list[list[float]]:
    camera = sys.modules[f"{MODULE}.camera"]
    points = camera.points_of(bpy.context, bpy.data.objects[name])
    return [[pick(axis) for axis in zip(*points, strict=True)] for pick in (min, max)]


def seen(name: str) -> list[float]:
    """The rectangle of an object in the scene's camera: left, bottom, right, top as shares of the picture."""
    from bpy_extras.object_utils import world_to_camera_view

    scene, points = bpy.context.scene, sys.modules[f"{MODULE}.camera"].points_of(bpy.context, bpy.data.objects[name])
    places = [world_to_camera_view(scene, scene.camera, point) for point in points]
    xs, ys = [p.x for p in places], [p.y for p in places]
    return [min(xs), min(ys), max(xs), max(ys)]


class Layout:
    """What a panel draws on: it keeps the texts, and refuses properties and operators that are not there."""

    def __init__(self, texts: list[str]) -> None:
        self.texts = texts

    def row(self, **_: object) -> "Layout":
        return self

    column = box = grid_flow = row

    def label(self, text: str) -> None:
        self.texts.append(text)

    def prop(self, owner, name: str, text: str = "", **_: object) -> None:
        owner.path_resolve(name)
        self.texts.append(text)

    def operator(self, name: str, text: str = "", **_: object) -> SimpleNamespace:
        group, _, operator = name.partition(".")
        getattr(getattr(bpy.ops, group), operator).get_rna_type()
        self.texts.append(text)
        return SimpleNamespace()

    def template_icon(self, number: int, scale: float) -> None:
        """In the background no picture has a number."""


def shown() -> list[str]:
    """The texts of all panels."""
    texts = []
    for panel in sys.modules[f"{MODULE}.panel"].CLASSES:
        if not hasattr(panel, "poll") or panel.poll(bpy.context):
            panel.draw(SimpleNamespace(layout=Layout(texts)), bpy.context)
    return texts


def click(operator, number: int) -> None:
    """As in the window, where a click is one step of undo."""
    operator("EXEC_DEFAULT", True, number=number)


def estimate(picture: str) -> dict:
    settings().picture = picture
    bpy.ops.dipcg.estimate()
    return sys.modules[f"{MODULE}.session"].estimated.result


def lamp(address: str, picture: str) -> dict:
    opened(address)
    bpy.ops.dipcg.connect()
    result = estimate(picture)
    bpy.ops.ed.undo_push(message="before")
    before = values()
    click(bpy.ops.dipcg.use_candidate, 1)
    after = {"values": values(), "bounds": bounds("Lamp"), "seen": seen("Lamp")}
    render, camera = bpy.context.scene.render, bpy.context.scene.camera
    after |= {"resolution": [render.resolution_x, render.resolution_y], "camera": camera.name}
    after |= {"behind": list(camera.data.background_images[0].image.size)}
    bpy.ops.ed.undo()
    undone = {"values": values(), "cameras": [o.name for o in bpy.data.objects if o.type == "CAMERA"]}
    found = {"generator": settings().generator, "result": result, "shown": shown()}
    pictures = sys.modules[f"{MODULE}.session"]._previews
    found |= {"thumbnails": [list(pictures[key].image_size) for key in sorted(pictures)]}
    return found | {"before": before, "after": after, "undone": undone}


def locked(address: str, picture: str, name: str, identifier: str, value: float) -> dict:
    opened(address)
    bpy.ops.dipcg.connect()
    bpy.data.objects["Lamp"].modifiers[0][identifier] = value
    settings().locks[name].held = True
    return estimate(picture)


def added(address: str, picture: str) -> dict:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    empty = str(Path(bpy.app.tempdir) / "empty.blend")
    bpy.ops.wm.save_as_mainfile(filepath=empty)
    opened(address, empty)
    bpy.ops.dipcg.connect()
    result = estimate(picture)
    click(bpy.ops.dipcg.add_candidate, 0)
    roots = [o for o in bpy.context.scene.objects if o.parent is None and o.type != "CAMERA"]
    meshes = [o for o in bpy.context.scene.objects if o.type == "MESH"]
    materials = [slot.material is not None for o in meshes for slot in o.material_slots]
    found = {"roots": [o.name for o in roots], "meshes": len(meshes), "materials": materials}
    return {"result": result, "seen": seen(roots[0].name), "bounds": bounds(roots[0].name)} | found


def truth(address: str, picture: str, params: dict, view: dict) -> list[float]:
    """What the camera sees of these parameters from this view, when the picture is its own cut-out."""
    opened(address)
    bpy.ops.dipcg.connect()
    inputs, camera, session = (sys.modules[f"{MODULE}.{name}"] for name in ("inputs", "camera", "session"))
    obj = bpy.data.objects["Lamp"]
    inputs.write(obj.modifiers[0], session.chosen(settings())["parameters"], params)
    camera.place(bpy.context, camera.points_of(bpy.context, obj), view, picture, picture)
    bpy.context.view_layer.update()
    return seen("Lamp")


def failing(cases: list) -> dict:
    """The sentence of each server and picture, and whether Blender and the add-on go on."""
    opened("")
    before, sentences, statuses, ready = values(), [], [], []
    for address, picture in cases:
        bpy.context.preferences.addons[MODULE].preferences.address = address
        settings().picture = picture
        sentences.append(said(bpy.ops.dipcg.connect) or said(bpy.ops.dipcg.estimate))
        statuses.append(settings().status)
        ready.append(bpy.ops.dipcg.estimate.poll())
    found = {"sentences": sentences, "status": statuses, "can go on": ready, "changed": values() != before}
    bpy.ops.preferences.addon_disable(module=MODULE)
    return found | {"left": hasattr(bpy.types.WindowManager, "dipcg")}


def learned(address: str, blend: str, name: str, ranges: dict, hold: list) -> dict:
    """Propose, edit, learn, stop, go on, and connect anew; what the panel says, and the values in the meantime."""
    opened(address, blend)
    bpy.context.view_layer.objects.active = bpy.data.objects[name]
    bpy.ops.dipcg.connect()
    bpy.ops.dipcg.propose()
    session = sys.modules[f"{MODULE}.session"]
    proposed = {one.name: [one.low, one.high] if one.is_number else None for one in settings().ranges}
    for one in settings().ranges:
        one.used = one.name not in hold
        if one.name in ranges:
            one.low, one.high = ranges[one.name]
    bpy.ops.dipcg.learn()
    # A look may miss any one step, but not all of them.
    notes = followed(lambda: "Step" in settings().progress)
    texts = shown()
    bpy.ops.dipcg.stop_learning()
    stopped, session.training = session.training, None
    followed(lambda: False)
    bpy.ops.dipcg.connect()
    found = session.training
    bpy.ops.dipcg.learn()
    notes += followed(lambda: False)
    return {
        "proposed": proposed,
        "notes": notes,
        "texts": texts,
        "stopped": stopped,
        "found": found,
        "done": session.training,
        "status": settings().status,
        "generator": settings().generator,
        "modifier": session.find_modifier(bpy.context.object, session.chosen(settings())) is not None,
    }


def followed(enough) -> list[str]:
    """Do what the timer does, since there is none in the background, and note what the panel says."""
    learning, notes = sys.modules[f"{MODULE}.learning"], []
    while learning.look() is not None and not enough():
        notes.append(settings().progress)
        time.sleep(0.1)
    return notes


def dying(address: str) -> dict:
    """The server of a training is gone: what the panel says, and whether another can be asked for."""
    opened(address)
    learning, session = (sys.modules[f"{MODULE}.{name}"] for name in ("learning", "session"))
    training = {"id": "gone", "state": "learning", "object": "Lamp", "parameters": [], "error": None}
    learning.watch(bpy.context, training)
    followed(lambda: False)
    return {"status": settings().status, "can go on": bpy.ops.dipcg.connect.poll(), "watching": bool(session.watching)}


def started(port: int, program: str, folder: str) -> dict:
    """Connect where no server runs: it is started by the program of the preferences."""
    opened(f"http://127.0.0.1:{port}")
    chosen = bpy.context.preferences.addons[MODULE].preferences
    before = said(bpy.ops.dipcg.connect)
    chosen.program, chosen.folder = "/nowhere/dipcg", folder
    wrong = said(bpy.ops.dipcg.connect)
    chosen.program = program
    bpy.ops.dipcg.connect()
    return {
        "before": before,
        "wrong": wrong,
        "command": sys.modules[f"{MODULE}.session"].command(bpy.context),
        "is newer": bpy.app.version[:2] > (4, 2),
        "python": sys.executable,
        "generators": [item[0] for item in sys.modules[f"{MODULE}.session"]._items],
    }


def stopping(address: str) -> dict:
    """Switched off while a thread waits for the server."""
    opened(address)
    bpy.ops.dipcg.connect()
    server, session = (sys.modules[f"{MODULE}.{name}"] for name in ("server", "session"))
    session.task = waiting = server.Task(lambda task: task.stopped.wait(60))
    busy = bpy.ops.dipcg.estimate.poll()
    bpy.ops.preferences.addon_disable(module=MODULE)
    waiting.join(5)
    return {"could start another": busy, "ended": not waiting.is_alive()}


if __name__ == "__main__":
    result = globals()[sys.argv[1]](**json.loads(sys.argv[2]))
    print("\n" + json.dumps(result), flush=True)
    # Blender sometimes crashes when it shuts down.
    os._exit(0)
